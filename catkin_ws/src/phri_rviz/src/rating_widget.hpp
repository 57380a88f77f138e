#pragma once
#include <phri_msgs/Trial.h>

#include <QWidget>

class QButtonGroup;
class QLabel;

namespace phri_rviz
{
/// How helpful the last trial was, 1 (hindered) to 6 (helped); can be used from a finished trial until the next starts.
class RatingWidget : public QWidget
{
  Q_OBJECT

public:
  explicit RatingWidget(QWidget* parent = nullptr);
  void setTrial(const phri_msgs::Trial& trial);
  /// No trial is known any more.
  void clear();
  /// What became of a rating.
  void setRated(int rating, bool success, const QString& text);

Q_SIGNALS:
  void rate(int rating);

private:
  void mark(int rating);

  QLabel* label_;
  QButtonGroup* buttons_;
  QString title_;
  int stored_ = 0;  // of this trial
};
}  // namespace phri_rviz
