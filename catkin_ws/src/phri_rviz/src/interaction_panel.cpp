#include "interaction_panel.hpp"

#include <pluginlib/class_list_macros.hpp>

#include <QAbstractItemView>
#include <QComboBox>
#include <QFormLayout>
#include <QFrame>
#include <QLabel>
#include <QLineEdit>
#include <QPushButton>
#include <QScrollArea>
#include <QVBoxLayout>

#include "interaction_client.hpp"
#include "plot_widget.hpp"
#include "rating_widget.hpp"
#include "state_widget.hpp"
#include "tuning_widget.hpp"

namespace phri_rviz
{
namespace
{
constexpr int kRefresh = 66;     // [ms]: 15 pictures a second
constexpr double kSilent = 1.0;  // [s] without a state until the node is said to be gone
constexpr int kAskAgain = 3000;  // [ms] after which an unanswered question for the controllers is asked again
constexpr int kSettle = 1000;    // [ms] after a switch until the states must show it
const char* const kSpace = "/phri";
const char* const kSpaceKey = "Namespace";

QFrame* line()
{
  auto* result = new QFrame;
  result->setFrameShape(QFrame::HLine);
  result->setFrameShadow(QFrame::Sunken);
  return result;
}
}  // namespace

InteractionPanel::InteractionPanel(QWidget* parent)
  : rviz::Panel(parent),
    client_(new InteractionClient(this)),
    state_(new StateWidget),
    controllers_(new QComboBox),
    plots_(new PlotWidget),
    tuning_(new TuningWidget),
    rating_(new RatingWidget),
    answer_(new QLabel),
    space_(new QLineEdit(kSpace))
{
  setObjectName("interactionPanel");
  buildLayout();
  connectSignals();
  setAlive(false);
}

InteractionPanel::~InteractionPanel() = default;

void InteractionPanel::buildLayout()
{
  auto* layout = new QVBoxLayout(this);
  layout->setContentsMargins(8, 8, 8, 6);
  layout->setSpacing(6);
  layout->addWidget(state_);

  auto* buttons = new QHBoxLayout;
  buttons->setSpacing(4);
  start_ = addButton("startButton", "Start", "start",
                     "go on: the object follows the hand, the robot assists as soon as it predicts");
  stop_ = addButton("stopButton", "Stop", "stop", "the object holds still (IDLE)");
  clear_fault_ = addButton("clearFaultButton", "Clear fault", "clear_fault",
                           "leave FAULT, once the cause is gone and everything is at rest");
  reset_ = addButton("resetButton", "Restart trial", "reset", "end the running trial; it begins again");
  for (QPushButton* button : { start_, stop_, clear_fault_, reset_ })
    buttons->addWidget(button);
  layout->addLayout(buttons);

  controllers_->setObjectName("controllerBox");
  controllers_->setSizePolicy(QSizePolicy::Expanding, QSizePolicy::Fixed);
  controllers_->setToolTip("controller of the running trial; first those of the experiment, then all others");
  auto* choice = new QFormLayout;
  choice->setContentsMargins(0, 0, 0, 0);
  choice->addRow("Controller", controllers_);
  choice->labelForField(controllers_)->setObjectName("controllerTitle");
  layout->addLayout(choice);
  layout->addWidget(plots_, 3);
  layout->addWidget(line());

  auto* area = new QScrollArea;
  area->setObjectName("tuningArea");
  area->setWidget(tuning_);
  area->setWidgetResizable(true);
  area->setFrameShape(QFrame::NoFrame);
  area->setHorizontalScrollBarPolicy(Qt::ScrollBarAlwaysOff);
  area->setMinimumHeight(90);
  layout->addWidget(area, 4);
  layout->addWidget(line());
  layout->addWidget(rating_);
  layout->addWidget(line());

  answer_->setObjectName("answerLabel");
  answer_->setTextFormat(Qt::PlainText);
  answer_->setWordWrap(true);
  answer_->setAlignment(Qt::AlignLeft | Qt::AlignTop);
  answer_->setMinimumHeight(2 * answer_->fontMetrics().lineSpacing());
  answer_->setTextInteractionFlags(Qt::TextSelectableByMouse);
  layout->addWidget(answer_);
  space_->setObjectName("namespaceEdit");
  space_->setToolTip("namespace of experiment_node and session_runner; saved with the rviz configuration");
  auto* where = new QFormLayout;
  where->setContentsMargins(0, 0, 0, 0);
  where->addRow("Namespace", space_);
  where->labelForField(space_)->setObjectName("namespaceTitle");
  layout->addLayout(where);
}

QPushButton* InteractionPanel::addButton(const QString& name, const QString& text, const QString& service,
                                         const QString& help)
{
  auto* button = new QPushButton(text);
  button->setObjectName(name);
  button->setToolTip(help);
  button->setMinimumHeight(30);
  button->setMinimumWidth(button->fontMetrics().horizontalAdvance(text) + 14);
  connect(button, &QPushButton::clicked, this, [this, service] {
    report(true, service + " ...");
    client_->trigger(service);
  });
  return button;
}

void InteractionPanel::connectSignals()
{
  connect(client_, &InteractionClient::answered, this,
          [this](const QString& service, bool success, const QString& text) {
            if (service == "switch_controller")
            {
              if (!success)
                wanted_.clear();
              settling_.start();
              showController(running_);
            }
            report(success, service + ": " + text);
          });
  connect(client_, &InteractionClient::controllersListed, this, &InteractionPanel::setControllers);
  connect(client_, &InteractionClient::trialChanged, rating_, &RatingWidget::setTrial);
  connect(client_, &InteractionClient::rated, rating_, &RatingWidget::setRated);
  connect(client_, &InteractionClient::tunablesDescribed, tuning_, &TuningWidget::setTunables);
  connect(client_, &InteractionClient::valuesInForce, tuning_, &TuningWidget::setValues);
  connect(client_, &InteractionClient::parametersAnswered, tuning_, &TuningWidget::setAnswer);
  connect(tuning_, &TuningWidget::request, client_, &InteractionClient::setParameters);
  connect(tuning_, &TuningWidget::report, this, &InteractionPanel::report);
  connect(rating_, &RatingWidget::rate, client_, &InteractionClient::rate);
  connect(controllers_, QOverload<int>::of(&QComboBox::activated), this, &InteractionPanel::chooseController);
  connect(space_, &QLineEdit::editingFinished, this, [this] {
    if (space_->text() != client_->space())
    {
      setSpace(space_->text());
      Q_EMIT configChanged();
    }
  });
  connect(&timer_, &QTimer::timeout, this, &InteractionPanel::refresh);
}

void InteractionPanel::onInitialize()
{
  if (client_->space().isEmpty())
    setSpace(kSpace);
  timer_.start(kRefresh);
}

void InteractionPanel::load(const rviz::Config& config)
{
  rviz::Panel::load(config);
  QString space = kSpace;
  config.mapGetString(kSpaceKey, &space);
  setSpace(space);
}

void InteractionPanel::save(rviz::Config config) const
{
  rviz::Panel::save(config);
  config.mapSetValue(kSpaceKey, client_->space());
}

void InteractionPanel::setSpace(const QString& space)
{
  QString why;
  if (space != client_->space() && !client_->connectTo(space, &why))
  {
    report(false, why);
    if (client_->space().isEmpty())
      client_->connectTo(kSpace, &why);
  }
  else
  {
    report(true, "");
    setAlive(false);
    plots_->clear();
    rating_->clear();
    tuning_->setTunables({});
    controllers_->clear();
    running_.clear();
  }
  space_->setText(client_->space());
}

void InteractionPanel::refresh()
{
  const std::vector<phri_msgs::ControllerState> states = client_->takeStates();
  const double silence = client_->silence();
  if (silence > kSilent)
  {
    setAlive(false);
    state_->showSilence(silence, client_->space() + "/experiment_node");
    return;
  }
  if (states.empty())
    return;
  setAlive(true);
  std::vector<PlotWidget::Sample> samples;
  samples.reserve(states.size());
  for (const auto& state : states)
    samples.push_back({ state.header.stamp.toSec(), state.human_force, state.assistance_force, state.disagreement });
  plots_->add(samples);
  if (controllers_->count() == 0 && asked_.hasExpired(kAskAgain))
    askForControllers();
  const phri_msgs::ControllerState& now = states.back();
  state_->show(now);
  start_->setEnabled(now.state != "ACTIVE" && now.state != "FAULT");
  clear_fault_->setEnabled(now.state == "FAULT");
  showController(QString::fromStdString(now.controller));
}

void InteractionPanel::setAlive(bool alive)
{
  if (alive && !alive_)
  {
    wanted_.clear();
    askForControllers();  // the node may be another one now
  }
  alive_ = alive;
  for (QWidget* widget :
       { static_cast<QWidget*>(start_), static_cast<QWidget*>(clear_fault_), static_cast<QWidget*>(reset_),
         static_cast<QWidget*>(controllers_), static_cast<QWidget*>(tuning_) })
    widget->setEnabled(alive);
}

void InteractionPanel::askForControllers()
{
  asked_.start();
  client_->listControllers();
}

void InteractionPanel::setControllers(const QStringList& experiment, const QStringList& available)
{
  controllers_->clear();
  controllers_->addItems(experiment);
  QStringList others;
  for (const QString& name : available)
    if (!experiment.contains(name))
      others << name;
  if (!others.isEmpty())
  {
    if (!experiment.isEmpty())
      controllers_->insertSeparator(controllers_->count());
    controllers_->addItems(others);
  }
  showController(running_);
}

void InteractionPanel::showController(const QString& running)
{
  if (running != running_)
    tuning_->unfold(running);  // the gains of this controller
  running_ = running;
  // states that were sent before the switch still arrive after its answer
  if (running == wanted_ || (settling_.isValid() && settling_.hasExpired(kSettle)))
    wanted_.clear();
  if (!controllers_->view()->isVisible())
    controllers_->setCurrentIndex(controllers_->findText(wanted_.isEmpty() ? running : wanted_));
}

void InteractionPanel::chooseController(int index)
{
  wanted_ = controllers_->itemText(index);
  settling_.invalidate();
  report(true, "switch_controller " + wanted_ + " ...");
  client_->switchController(wanted_);
}

void InteractionPanel::report(bool success, const QString& text)
{
  answer_->setStyleSheet(success ? "color: #37474f;" : "color: #b71c1c;");
  answer_->setText(text);
}
}  // namespace phri_rviz

PLUGINLIB_EXPORT_CLASS(phri_rviz::InteractionPanel, rviz::Panel)
