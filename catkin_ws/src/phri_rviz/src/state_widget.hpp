#pragma once
#include <phri_msgs/ControllerState.h>

#include <QFrame>

class QLabel;

namespace phri_rviz
{
/// The state of the interaction loop as a coloured bar, what the operator should know under it, and one line of
/// figures.
class StateWidget : public QWidget
{
  Q_OBJECT

public:
  explicit StateWidget(QWidget* parent = nullptr);
  void show(const phri_msgs::ControllerState& state);
  /// Nothing arrived for `seconds`.
  void showSilence(double seconds, const QString& node);

private:
  void setState(const QString& state, const QString& color);

  QFrame* bar_;
  QLabel *state_, *trial_, *message_, *figures_;
  QString color_;
};
}  // namespace phri_rviz
