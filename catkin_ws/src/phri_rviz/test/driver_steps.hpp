#pragma once
#include <QElapsedTimer>
#include <QStringList>
#include <QTimer>
#include <QWidget>
#include <stdexcept>

namespace phri_rviz
{
/// A step that cannot be done, and why.
struct StepError : std::runtime_error
{
  explicit StepError(const QString& text) : std::runtime_error(text.toStdString()) {}
};

/// Operates the widgets of a window as a person would, by Qt test events. WIDGET is an object name. A widget that a
/// person could not reach (hidden, disabled, covered) is an error.
///
///   click WIDGET                  mouse click
///   choose BOX ITEM               opens a combo box and takes an item
///   set FIELD TEXT                replaces the text of a line edit and presses Return
///   drag SLIDER FROM TO           pulls the handle of a slider; shares of its length, 0 .. 1
///   rate N                        click ratingButtonN
///   wait WIDGET[.PROPERTY] TEXT SECONDS   until the property (what it shows) contains the text
///   read WIDGET[.PROPERTY]        prints it
///   screenshot FILE               the whole window; prints size, mean brightness and number of colours of the 3-D view
///   save FILE                     the configuration of rviz, as it is now
///   ticks                         prints how often a timer of 10 ms fired since the last `ticks`
///   pause SECONDS
class DriverSteps
{
public:
  explicit DriverSteps(QWidget& window);
  /// Returns what is to be printed. Throws StepError.
  QString run(const QStringList& step);

private:
  QWidget* find(const QString& name) const;
  QWidget* reach(const QString& name) const;
  QString shown(const QString& what) const;
  void choose(const QString& name, const QString& item) const;
  void set(const QString& name, const QString& text) const;
  void drag(const QString& name, double from, double to) const;
  void wait(const QString& what, const QString& text, double seconds) const;
  QString screenshot(const QString& file) const;

  QWidget& window_;
  QTimer timer_;
  int ticks_ = 0;
};
}  // namespace phri_rviz
