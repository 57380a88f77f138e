#pragma once
#include <rviz/panel.h>

#include <QElapsedTimer>
#include <QTimer>

class QComboBox;
class QLabel;
class QLineEdit;
class QPushButton;

namespace phri_rviz
{
class InteractionClient;
class PlotWidget;
class RatingWidget;
class StateWidget;
class TuningWidget;

/// Front end of an experiment node and its session runner: see README. The namespace that they are in is kept in the
/// rviz configuration (key Namespace). Every widget has an object name.
class InteractionPanel : public rviz::Panel
{
  Q_OBJECT

public:
  explicit InteractionPanel(QWidget* parent = nullptr);
  ~InteractionPanel() override;
  void onInitialize() override;
  void load(const rviz::Config& config) override;
  void save(rviz::Config config) const override;

private:
  void buildLayout();
  QPushButton* addButton(const QString& name, const QString& text, const QString& service, const QString& help);
  void connectSignals();
  void setSpace(const QString& space);
  void refresh();
  void setAlive(bool alive);
  void askForControllers();
  void setControllers(const QStringList& experiment, const QStringList& available);
  void showController(const QString& running);
  void chooseController(int index);
  void report(bool success, const QString& text);

  InteractionClient* client_;
  StateWidget* state_;
  QPushButton *start_ = nullptr, *stop_ = nullptr, *clear_fault_ = nullptr, *reset_ = nullptr;
  QComboBox* controllers_;
  PlotWidget* plots_;
  TuningWidget* tuning_;
  RatingWidget* rating_;
  QLabel* answer_;
  QLineEdit* space_;
  QTimer timer_;
  bool alive_ = false;
  QElapsedTimer asked_;     // since the controllers were asked for
  QString running_;         // controller, by the last state
  QString wanted_;          // controller that was chosen, until the states show it; empty: none
  QElapsedTimer settling_;  // since the answer to that choice; invalid before it
};
}  // namespace phri_rviz
