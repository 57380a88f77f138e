#include "tuning_widget.hpp"

#include <QGridLayout>
#include <QLabel>
#include <QLineEdit>
#include <QLocale>
#include <QSlider>
#include <QToolButton>
#include <QVBoxLayout>
#include <QWheelEvent>
#include <cmath>

namespace phri_rviz
{
namespace
{
constexpr double kPeriod = 0.1;  // [s] between requests
constexpr int kLook = 20;        // [ms] between looks whether one is due
constexpr double kSame = 1e-9;   // relative difference that is not called a difference

bool same(double a, double b)
{
  return std::abs(a - b) <= kSame * std::max(std::abs(a), std::abs(b));
}

bool operator==(const Tunable& a, const Tunable& b)
{
  return a.name == b.name && a.meaning == b.meaning && a.unit == b.unit && a.minimum == b.minimum &&
         a.maximum == b.maximum && a.standard == b.standard;
}

bool equal(const QVector<Tunable>& a, const QVector<Tunable>& b)
{
  return a.size() == b.size() &&
         std::equal(a.begin(), a.end(), b.begin(), [](const Tunable& x, const Tunable& y) { return x == y; });
}

QString groupOf(const QString& name)
{
  return name.contains('/') ? name.section('/', 0, 0) : "general";
}

QString plain(QString text)
{
  return text.replace('_', ' ').replace('/', ' ');
}

QString withUnit(double value, const QString& unit)
{
  return format(value) + (unit.isEmpty() ? "" : " " + unit);
}

/// A slider that leaves the mouse wheel to the scroll area: scrolling past it must not change a gain.
class Slider : public QSlider
{
public:
  Slider() : QSlider(Qt::Horizontal) {}

protected:
  void wheelEvent(QWheelEvent* event) override { event->ignore(); }
};
}  // namespace

TuningWidget::TuningWidget(QWidget* parent)
  : QWidget(parent), layout_(new QVBoxLayout(this)), empty_(new QLabel("no tunable parameters yet")), pacer_(kPeriod)
{
  layout_->setContentsMargins(0, 0, 4, 0);
  layout_->setSpacing(2);
  empty_->setObjectName("tuningEmptyLabel");
  empty_->setStyleSheet("color: #5a6068;");
  layout_->addWidget(empty_);
  layout_->addStretch();
  clock_.start();
  connect(&timer_, &QTimer::timeout, this, &TuningWidget::send);
}

void TuningWidget::setTunables(const QVector<Tunable>& tunables)
{
  if (equal(tunables, tunables_))
    return;
  tunables_ = tunables;
  timer_.stop();
  pacer_.clear();
  rows_.clear();
  for (QWidget* group : findChildren<QWidget*>("tuningGroup"))
    delete group;
  empty_->setVisible(tunables.isEmpty());
  QStringList order;
  QMap<QString, QVector<Tunable>> groups;
  for (const Tunable& tunable : tunables)
  {
    const QString group = groupOf(tunable.name);
    if (!groups.contains(group))
      order << group;
    groups[group].push_back(tunable);
  }
  for (int i = 0; i < order.size(); ++i)
    layout_->insertWidget(layout_->count() - 1, makeGroup(order[i], groups[order[i]], i == 0 || order[i] == open_));
  // the sliders of all groups begin at one line
  int widest = 0;
  for (const QLabel* title : findChildren<QLabel*>("tuningTitle"))
    widest = std::max(widest, title->sizeHint().width());
  for (QLabel* title : findChildren<QLabel*>("tuningTitle"))
    title->setMinimumWidth(widest);
  if (tunables.isEmpty())
    in_force_.clear();
  setValues(Values(in_force_));
}

void TuningWidget::unfold(const QString& group)
{
  open_ = group;
  if (auto* fold = findChild<QToolButton*>("tuning/" + group + "/fold"))
    fold->setChecked(true);
}

QWidget* TuningWidget::makeGroup(const QString& group, const QVector<Tunable>& tunables, bool open)
{
  auto* result = new QWidget;
  result->setObjectName("tuningGroup");
  auto* column = new QVBoxLayout(result);
  column->setContentsMargins(0, 0, 0, 0);
  column->setSpacing(0);
  auto* fold = new QToolButton;
  fold->setObjectName("tuning/" + group + "/fold");
  fold->setText(plain(group));
  fold->setToolButtonStyle(Qt::ToolButtonTextBesideIcon);
  fold->setAutoRaise(true);
  fold->setCheckable(true);
  fold->setStyleSheet("QToolButton { font-weight: bold; border: none; padding: 3px 0px; }");
  column->addWidget(fold);
  auto* body = new QWidget;
  body->setObjectName("tuning/" + group + "/body");
  column->addWidget(body);
  const auto unfold = [fold, body](bool shown) {
    fold->setArrowType(shown ? Qt::DownArrow : Qt::RightArrow);
    body->setVisible(shown);
  };
  connect(fold, &QToolButton::toggled, body, unfold);
  fold->setChecked(open);
  unfold(open);

  auto* grid = new QGridLayout(body);
  grid->setContentsMargins(14, 0, 0, 4);
  grid->setHorizontalSpacing(6);
  grid->setVerticalSpacing(3);
  grid->setColumnStretch(1, 1);
  for (int line = 0; line < tunables.size(); ++line)
  {
    const Tunable& tunable = tunables[line];
    const QString name = tunable.name;
    Row& row = rows_[name];
    row.tunable = tunable;
    row.scale = SliderScale(tunable.minimum, tunable.maximum, tunable.standard);
    auto* title = new QLabel(plain(name.contains('/') ? name.section('/', 1) : name));
    title->setObjectName("tuningTitle");
    row.slider = new Slider;
    row.slider->setObjectName("tuning/" + name + "/slider");
    row.slider->setRange(0, SliderScale::kPositions);
    row.slider->setMinimumWidth(80);
    row.slider->setEnabled(tunable.minimum < tunable.maximum);
    row.edit = new QLineEdit;
    row.edit->setObjectName("tuning/" + name);
    row.edit->setAlignment(Qt::AlignRight);
    row.edit->setFixedWidth(row.edit->fontMetrics().horizontalAdvance("-0.000000e+00"));
    row.edit->setEnabled(row.slider->isEnabled());
    auto* unit = new QLabel(QString(tunable.unit).replace("^2", "²").replace("^3", "³"));
    unit->setObjectName("tuning/" + name + "/unit");
    unit->setMinimumWidth(unit->fontMetrics().horizontalAdvance("Ns/m."));
    const QString help = QString("%1\n%2, %3 to %4, default %5")
                             .arg(tunable.meaning, name, format(tunable.minimum),
                                  withUnit(tunable.maximum, tunable.unit), format(tunable.standard));
    for (QWidget* widget : { static_cast<QWidget*>(title), static_cast<QWidget*>(row.slider),
                             static_cast<QWidget*>(row.edit), static_cast<QWidget*>(unit) })
      widget->setToolTip(help);
    grid->addWidget(title, line, 0);
    grid->addWidget(row.slider, line, 1);
    grid->addWidget(row.edit, line, 2);
    grid->addWidget(unit, line, 3);
    row.in_force = tunable.standard;
    show(row, row.in_force);
    connect(row.slider, &QSlider::valueChanged, this, [this, name](int position) { slide(name, position); });
    connect(row.edit, &QLineEdit::editingFinished, this, [this, name] { enterText(name); });
  }
  return result;
}

void TuningWidget::show(Row& row, double value, bool move_slider)
{
  row.scale.cover(value);
  row.edit->setText(format(value));
  row.edit->setModified(false);
  if (move_slider)
  {
    const QSignalBlocker quiet(row.slider);  // only the user's own moves are requests
    row.slider->setValue(row.scale.position(value));
  }
}

void TuningWidget::mark(Row& row, const QString& problem)
{
  row.edit->setStyleSheet(problem.isEmpty() ? "" : "border: 1px solid #c62828;");
}

void TuningWidget::setValues(const Values& in_force)
{
  for (auto value = in_force.begin(); value != in_force.end(); ++value)
  {
    if (!std::isfinite(value.value()))
      continue;
    in_force_.insert(value.key(), value.value());
    const auto row = rows_.find(value.key());
    if (row == rows_.end())
      continue;
    row->in_force = value.value();
    if (!pacer_.isPending(value.key()) && !row->slider->isSliderDown() && !row->edit->isModified())
      show(*row, value.value());
  }
}

void TuningWidget::slide(const QString& name, int position)
{
  Row& row = rows_[name];
  const double value = row.scale.value(position);
  show(row, value, false);
  put(name, value);
}

void TuningWidget::enterText(const QString& name)
{
  Row& row = rows_[name];
  if (!row.edit->isModified())
    return;
  bool number = false;
  const QString text = row.edit->text().trimmed();
  const double value = QLocale::c().toDouble(text, &number);
  const Tunable& tunable = row.tunable;
  if (number && value >= tunable.minimum && value <= tunable.maximum)
  {
    show(row, value);
    return put(name, value);
  }
  const QString problem = number ? QString("%1 is outside %2 to %3")
                                       .arg(text, format(tunable.minimum), withUnit(tunable.maximum, tunable.unit))
                                 : QString("'%1' is not a number").arg(text);
  show(row, row.in_force);
  mark(row, problem);
  Q_EMIT report(false, QString("%1: %2; it stays %3").arg(name, problem, withUnit(row.in_force, tunable.unit)));
}

void TuningWidget::put(const QString& name, double value)
{
  mark(rows_[name], "");
  pacer_.put(name, value);
  send();
  if (!timer_.isActive())
    timer_.start(kLook);
}

void TuningWidget::send()
{
  const Values now = pacer_.take(clock_.elapsed() * 1e-3);
  if (pacer_.idle())
    timer_.stop();
  if (!now.isEmpty())
    Q_EMIT request(now);
}

void TuningWidget::setAnswer(const Values& asked, bool success, const Values& in_force, const QString& text)
{
  pacer_.answered();
  setValues(in_force);
  QStringList kept, changed;
  for (auto value = asked.begin(); value != asked.end(); ++value)
  {
    const auto row = rows_.find(value.key());
    if (row == rows_.end())
      continue;
    const bool taken = success && in_force.contains(value.key()) && same(row->in_force, value.value());
    const QString stays = withUnit(row->in_force, row->tunable.unit);
    if (taken)
      changed << QString("%1 = %2").arg(value.key(), stays);
    else
      kept << QString("%1 = %2 refused, it stays %3").arg(value.key(), format(value.value()), stays);
    mark(*row, taken ? "" : text);
    if (!taken && !pacer_.isWaiting(value.key()))
      show(*row, row->in_force);
  }
  if (!kept.isEmpty())
    Q_EMIT report(false, kept.join("; ") + (text.isEmpty() ? "" : " (" + text + ")"));
  else if (!changed.isEmpty())
    Q_EMIT report(true, changed.join("; "));
}
}  // namespace phri_rviz
