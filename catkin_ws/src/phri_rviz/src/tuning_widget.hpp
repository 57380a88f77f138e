#pragma once
#include <QElapsedTimer>
#include <QMap>
#include <QTimer>
#include <QWidget>

#include "request_pacer.hpp"
#include "slider_scale.hpp"
#include "tunable.hpp"

class QLabel;
class QLineEdit;
class QSlider;
class QVBoxLayout;

namespace phri_rviz
{
/// A slider and a text field for every parameter, in groups that fold, by the part of the name before the first slash.
///
/// What is shown is the value in force, or the one that the user is about to set. Widgets: tuning/<name> is the text
/// field, tuning/<name>/slider, tuning/<group>/fold.
class TuningWidget : public QWidget
{
  Q_OBJECT

public:
  explicit TuningWidget(QWidget* parent = nullptr);
  /// Keeps the widgets when nothing changed. None at all: another node, of which nothing is known yet.
  void setTunables(const QVector<Tunable>& tunables);
  /// May come before the parameters are described: they are two topics.
  void setValues(const Values& in_force);
  /// Opens this group, now or when it is described; no other one closes.
  void unfold(const QString& group);
  /// The answer to `request`; `text` says what went wrong.
  void setAnswer(const Values& asked, bool success, const Values& in_force, const QString& text);

Q_SIGNALS:
  /// At most ten times a second, and not before the answer to the last one.
  void request(const phri_rviz::Values& values);
  /// One line for the operator.
  void report(bool success, const QString& text);

private:
  struct Row
  {
    Tunable tunable;
    SliderScale scale;
    double in_force = 0;  // the default, until it is known
    QSlider* slider = nullptr;
    QLineEdit* edit = nullptr;
  };

  QWidget* makeGroup(const QString& group, const QVector<Tunable>& tunables, bool open);
  void slide(const QString& name, int position);
  void enterText(const QString& name);
  void put(const QString& name, double value);
  void show(Row& row, double value, bool move_slider = true);
  void mark(Row& row, const QString& problem);
  void send();

  QVBoxLayout* layout_;
  QLabel* empty_;
  QString open_;  // group that is to be open besides the first
  QVector<Tunable> tunables_;
  QMap<QString, Row> rows_;
  Values in_force_;
  RequestPacer pacer_;
  QTimer timer_;
  QElapsedTimer clock_;
};
}  // namespace phri_rviz
