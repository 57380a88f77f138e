#include "driver_steps.hpp"

#include <rviz/render_panel.h>
#include <rviz/visualization_frame.h>

#include <QAbstractItemView>
#include <QApplication>
#include <QComboBox>
#include <QLineEdit>
#include <QScreen>
#include <QScrollArea>
#include <QSet>
#include <QSlider>
#include <QStyleOptionSlider>
#include <QtTest/QTest>

namespace phri_rviz
{
namespace
{
constexpr int kReach = 5000;     // [ms] for a widget to become reachable, a popup to open
constexpr int kDragSteps = 30;   // mouse moves of one drag
constexpr int kDragPause = 20;   // [ms] between them
constexpr int kBits = 0xf0f0f0;  // colours are counted to four bits, so that antialiasing is not colourful

double number(const QString& text)
{
  bool good = false;
  const double value = text.toDouble(&good);
  if (!good)
    throw StepError("'" + text + "' is not a number");
  return value;
}

template <class Widget>
Widget* as(QWidget* widget, const char* type)
{
  auto* result = qobject_cast<Widget*>(widget);
  if (!result)
    throw StepError(widget->objectName() + " is no " + type);
  return result;
}
}  // namespace

DriverSteps::DriverSteps(QWidget& window) : window_(window)
{
  QObject::connect(&timer_, &QTimer::timeout, [this] { ++ticks_; });
  timer_.start(10);
}

QWidget* DriverSteps::find(const QString& name) const
{
  auto* widget = window_.findChild<QWidget*>(name);
  if (!widget)
    throw StepError("no widget is named " + name);
  return widget;
}

QWidget* DriverSteps::reach(const QString& name) const
{
  QString why;
  const auto reachable = [&] {
    QWidget* widget = find(name);  // anew each time: the panel makes some of them again
    for (QWidget* parent = widget->parentWidget(); parent; parent = parent->parentWidget())
      if (auto* area = qobject_cast<QScrollArea*>(parent))
        area->ensureWidgetVisible(widget);
    const QWidget* seen = QApplication::widgetAt(widget->mapToGlobal(widget->rect().center()));
    why = !widget->isVisible()                                       ? "is hidden"
          : !widget->isEnabled()                                     ? "is disabled"
          : !seen || (seen != widget && !widget->isAncestorOf(seen)) ? "is covered"
                                                                     : "";
    return why.isEmpty();
  };
  if (!QTest::qWaitFor(reachable, kReach))
    throw StepError(name + " " + why);
  return find(name);
}

QString DriverSteps::shown(const QString& what) const
{
  const QWidget* widget = find(what.section('.', 0, 0));
  QString property = what.section('.', 1);
  if (property.isEmpty())
    property = qobject_cast<const QComboBox*>(widget) ? "currentText" : "text";
  const QVariant value = widget->property(property.toUtf8());
  if (!value.isValid())
    throw StepError(widget->objectName() + " has no property " + property);
  return value.toString();
}

void DriverSteps::choose(const QString& name, const QString& item) const
{
  auto* box = as<QComboBox>(reach(name), "combo box");
  if (box->findText(item) < 0)
    throw StepError(name + " has no item " + item);
  QTest::mouseClick(box, Qt::LeftButton);
  QAbstractItemView* list = box->view();
  if (!QTest::qWaitFor([list] { return list->isVisible(); }, kReach))
    throw StepError(name + " does not open");
  // by the keyboard: Qt ignores mouse releases for a while after a popup has opened
  for (int step = 0; step < 2 * box->count() && list->currentIndex().data().toString() != item; ++step)
    QTest::keyClick(list, box->findText(item) > list->currentIndex().row() ? Qt::Key_Down : Qt::Key_Up);
  QTest::keyClick(list, Qt::Key_Return);
  if (!QTest::qWaitFor([list] { return !list->isVisible(); }, kReach))
    throw StepError(name + " does not close");
}

void DriverSteps::set(const QString& name, const QString& text) const
{
  auto* field = as<QLineEdit>(reach(name), "line edit");
  field->setFocus();
  field->selectAll();
  QTest::keyClicks(field, text);
  QTest::keyClick(field, Qt::Key_Return);
}

void DriverSteps::drag(const QString& name, double from, double to) const
{
  auto* slider = as<QSlider>(reach(name), "slider");
  slider->setFocus();
  QStyleOptionSlider option;
  option.initFrom(slider);
  option.orientation = slider->orientation();
  option.minimum = slider->minimum();
  option.maximum = slider->maximum();
  option.sliderPosition = slider->sliderPosition();
  const QRect handle = slider->style()->subControlRect(QStyle::CC_Slider, &option, QStyle::SC_SliderHandle, slider);
  const int y = slider->height() / 2, length = slider->width();
  QTest::mousePress(slider, Qt::LeftButton, Qt::NoModifier, handle.center());
  for (int step = 0; step <= kDragSteps; ++step)
  {
    const double share = from + (to - from) * step / kDragSteps;
    // QTest::mouseMove carries no button; sliders follow only moves with the button down
    const QPoint point(int(share * length), y);
    QMouseEvent move(QEvent::MouseMove, point, slider->mapToGlobal(point), Qt::NoButton, Qt::LeftButton,
                     Qt::NoModifier);
    QApplication::sendEvent(slider, &move);
    QTest::qWait(kDragPause);
  }
  QTest::mouseRelease(slider, Qt::LeftButton, Qt::NoModifier, QPoint(int(to * length), y));
}

void DriverSteps::wait(const QString& what, const QString& text, double seconds) const
{
  QString last;
  const auto there = [&] {
    last = window_.findChild<QWidget*>(what.section('.', 0, 0)) ? shown(what) : "(no such widget)";
    return last.contains(text);
  };
  if (!QTest::qWaitFor(there, int(seconds * 1000)))
    throw StepError(QString("%1 shows '%2', not '%3', after %4 s").arg(what, last, text).arg(seconds));
}

QString DriverSteps::screenshot(const QString& file) const
{
  const QImage picture = window_.screen()->grabWindow(window_.winId()).toImage().convertToFormat(QImage::Format_RGB32);
  if (!picture.save(file))
    throw StepError("cannot write " + file);
  const auto* view = window_.findChild<rviz::RenderPanel*>();
  if (!view)
    throw StepError("the window has no 3-D view");
  const QRect area = QRect(view->mapTo(&window_, QPoint(0, 0)), view->size()) & picture.rect();
  double brightness = 0;
  QSet<QRgb> colors;
  for (int y = area.top(); y <= area.bottom(); ++y)
    for (int x = area.left(); x <= area.right(); ++x)
    {
      brightness += qGray(picture.pixel(x, y));
      colors.insert(picture.pixel(x, y) & kBits);
    }
  return QString("%1 %2 %3 %4")
      .arg(picture.width())
      .arg(picture.height())
      .arg(brightness / (double(area.width()) * area.height()), 0, 'f', 1)
      .arg(colors.size());
}

QString DriverSteps::run(const QStringList& step)
{
  const QString verb = step.value(0), first = step.value(1), second = step.value(2), third = step.value(3);
  const auto is = [&](const char* name, int arguments) {
    if (verb == name && step.size() != arguments + 1)
      throw StepError(QString("%1 takes %2 arguments, not %3").arg(verb).arg(arguments).arg(step.size() - 1));
    return verb == name;
  };
  if (is("click", 1))
    QTest::mouseClick(reach(first), Qt::LeftButton);
  else if (is("rate", 1))
    QTest::mouseClick(reach("ratingButton" + first), Qt::LeftButton);
  else if (is("choose", 2))
    choose(first, second);
  else if (is("set", 2))
    set(first, second);
  else if (is("drag", 3))
    drag(first, number(second), number(third));
  else if (is("wait", 3))
    wait(first, second, number(third));
  else if (is("read", 1))
    return shown(first);
  else if (is("screenshot", 1))
    return screenshot(first);
  else if (is("ticks", 0))
    return QString::number(std::exchange(ticks_, 0));
  else if (is("pause", 1))
    QTest::qWait(int(number(first) * 1000));
  else if (is("save", 1))
  {
    auto* frame = qobject_cast<rviz::VisualizationFrame*>(&window_);
    if (!frame || !frame->saveDisplayConfig(first))
      throw StepError("cannot save " + first);
  }
  else
    throw StepError("no step is named '" + verb + "'");
  return "";
}
}  // namespace phri_rviz
