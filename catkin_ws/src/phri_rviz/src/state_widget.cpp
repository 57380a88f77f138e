#include "state_widget.hpp"

#include <QHBoxLayout>
#include <QLabel>
#include <QMap>
#include <QVBoxLayout>

namespace phri_rviz
{
namespace
{
const char* const kGrey = "#7d8288";
const QMap<QString, QString> kColors{
  { "INIT", kGrey }, { "IDLE", "#5c7186" }, { "PASSIVE", "#2f77b5" }, { "ACTIVE", "#2e8b4a" }, { "FAULT", "#c62828" }
};

/// What a state means, for people who see it for the first time; shown while there is nothing else to say.
const QMap<QString, QString> kMeanings{ { "INIT", "not configured yet" },
                                        { "IDLE", "holds still" },
                                        { "PASSIVE", "follows the hand, without assistance" },
                                        { "ACTIVE", "the robot assists" } };

QLabel* label(const QString& name, const QString& style = "")
{
  auto* result = new QLabel;
  result->setObjectName(name);
  result->setTextFormat(Qt::PlainText);
  result->setStyleSheet(style);
  return result;
}

QString joined(const std::vector<std::string>& names)
{
  QStringList list;
  for (const std::string& name : names)
    list << QString::fromStdString(name);
  return list.isEmpty() ? "none" : list.join(", ");
}
}  // namespace

StateWidget::StateWidget(QWidget* parent)
  : QWidget(parent),
    bar_(new QFrame),
    state_(label("stateLabel", "color: white; font-size: 20pt; font-weight: bold;")),
    trial_(label("loopLabel", "color: white;")),
    message_(label("messageLabel")),
    figures_(label("figuresLabel", "color: #5a6068;"))
{
  bar_->setObjectName("stateBar");
  auto* bar = new QHBoxLayout(bar_);
  bar->setContentsMargins(12, 6, 12, 6);
  bar->addWidget(state_);
  bar->addStretch();
  bar->addWidget(trial_);
  trial_->setAlignment(Qt::AlignRight | Qt::AlignVCenter);

  message_->setWordWrap(true);
  message_->setAlignment(Qt::AlignLeft | Qt::AlignTop);
  // room for two lines, so that nothing below jumps when a message comes or goes
  message_->setMinimumHeight(2 * message_->fontMetrics().lineSpacing());
  QFont small = figures_->font();
  small.setPointSizeF(small.pointSizeF() * 0.9);
  figures_->setFont(small);
  figures_->setMinimumWidth(1);  // may be cut off rather than widen the panel; whole in the tool tip

  auto* layout = new QVBoxLayout(this);
  layout->setContentsMargins(0, 0, 0, 0);
  layout->setSpacing(4);
  layout->addWidget(bar_);
  layout->addWidget(message_);
  layout->addWidget(figures_);
  showSilence(0, "experiment_node");
}

void StateWidget::setState(const QString& state, const QString& color)
{
  state_->setText(state);
  if (color == color_)
    return;
  color_ = color;
  bar_->setStyleSheet(QString("#stateBar { background: %1; border-radius: 6px; }").arg(color));
}

void StateWidget::show(const phri_msgs::ControllerState& state)
{
  const QString name = QString::fromStdString(state.state);
  const bool fault = name == "FAULT";
  setState(name, kColors.value(name, kGrey));
  trial_->setText(QString("%1\n%2 s").arg(QString::fromStdString(state.controller)).arg(state.t, 0, 'f', 1));
  QString message = QString::fromStdString(state.message);
  if (fault)
    message = QString::fromStdString(state.fault_name) + (message.isEmpty() ? "" : ": ") + message;
  message_->setStyleSheet(fault ? "color: #b71c1c; font-weight: bold;" : message.isEmpty() ? "color: #5a6068;" : "");
  message_->setText(message.isEmpty() ? kMeanings.value(name) : message);
  const QString figures = QString("tank %1 J   late %2 ms   limits: %3")
                              .arg(state.tank, 0, 'f', 2)
                              .arg(state.lateness * 1e3, 0, 'f', 2)
                              .arg(joined(state.limit_names));
  figures_->setText(figures);
  figures_->setToolTip("energy tank of the assistance, lateness of the last cycle, limits that act: " + figures);
}

void StateWidget::showSilence(double seconds, const QString& node)
{
  setState("NO STATE", kGrey);
  trial_->clear();
  figures_->clear();
  message_->setStyleSheet("color: #8a4b00; font-weight: bold;");
  message_->setText(QString("no state for %1 s: is %2 running?").arg(seconds, 0, 'f', 1).arg(node));
}
}  // namespace phri_rviz
