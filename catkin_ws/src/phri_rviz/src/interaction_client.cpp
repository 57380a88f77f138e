#include "interaction_client.hpp"

#include <dynamic_reconfigure/Reconfigure.h>
#include <phri_msgs/ListControllers.h>
#include <phri_msgs/Rate.h>
#include <phri_msgs/SwitchController.h>
#include <std_srvs/Trigger.h>

#include <QRunnable>
#include <chrono>
#include <utility>

#include "service_call.hpp"

namespace phri_rviz
{
namespace
{
constexpr double kTimeout = 2.0;           // [s] for the answer of a service
constexpr std::size_t kMostStates = 2000;  // 20 s of them
constexpr int kMostCalls = 32;             // at once; more wait for one to end, 2 s at most

double steadyTime()
{
  return std::chrono::duration<double>(std::chrono::steady_clock::now().time_since_epoch()).count();
}

class Job : public QRunnable
{
public:
  explicit Job(std::function<void()> work) : work_(std::move(work)) {}
  void run() override { work_(); }

private:
  std::function<void()> work_;
};

QStringList list(const std::vector<std::string>& names)
{
  QStringList result;
  for (const std::string& name : names)
    result << QString::fromStdString(name);
  return result;
}
}  // namespace

InteractionClient::InteractionClient(QObject* parent) : QObject(parent), last_heard_(steadyTime())
{
  pool_.setMaxThreadCount(kMostCalls);
}

InteractionClient::~InteractionClient()
{
  give_up_ = true;
  subscribers_.clear();
  if (spinner_)
    spinner_->stop();
  pool_.clear();
  pool_.waitForDone();
}

bool InteractionClient::connectTo(const QString& space, QString* why)
{
  std::string error;
  const std::string name = space.toStdString();
  if (name.empty() || name[0] != '/' || !ros::names::validate(name, error))
  {
    *why =
        QString("namespace '%1': %2").arg(space, error.empty() ? "must begin with /" : QString::fromStdString(error));
    return false;
  }
  ++connection_;
  subscribers_.clear();
  if (spinner_)
    spinner_->stop();
  queue_.clear();
  takeStates();
  space_ = space;
  last_heard_ = steadyTime();
  node_ = std::make_unique<ros::NodeHandle>(name);
  node_->setCallbackQueue(&queue_);

  subscribers_.push_back(node_->subscribe<phri_msgs::ControllerState>(
      "experiment_node/state", 500,
      boost::function<void(const phri_msgs::ControllerState::ConstPtr&)>([this](const auto& message) {
        heard();
        const std::lock_guard<std::mutex> lock(states_mutex_);
        if (states_.size() == kMostStates)
          states_.erase(states_.begin(), states_.begin() + kMostStates / 2);
        states_.push_back(*message);
      })));
  subscribers_.push_back(node_->subscribe<phri_msgs::Trial>(
      "trial", 10, boost::function<void(const phri_msgs::Trial::ConstPtr&)>([this](const auto& message) {
        post([this, message] { Q_EMIT trialChanged(*message); });
      })));
  subscribers_.push_back(node_->subscribe<dynamic_reconfigure::ConfigDescription>(
      "experiment_node/parameter_descriptions", 1,
      boost::function<void(const dynamic_reconfigure::ConfigDescription::ConstPtr&)>([this](const auto& message) {
        post([this, described = tunables(*message)] { Q_EMIT tunablesDescribed(described); });
      })));
  subscribers_.push_back(node_->subscribe<dynamic_reconfigure::Config>(
      "experiment_node/parameter_updates", 10,
      boost::function<void(const dynamic_reconfigure::Config::ConstPtr&)>([this](const auto& message) {
        post([this, in_force = values(*message)] { Q_EMIT valuesInForce(in_force); });
      })));
  spinner_ = std::make_unique<ros::AsyncSpinner>(1, &queue_);
  spinner_->start();
  return true;
}

void InteractionClient::heard()
{
  last_heard_ = steadyTime();
}

double InteractionClient::silence() const
{
  return steadyTime() - last_heard_;
}

std::vector<phri_msgs::ControllerState> InteractionClient::takeStates()
{
  const std::lock_guard<std::mutex> lock(states_mutex_);
  return std::exchange(states_, {});
}

void InteractionClient::post(std::function<void()> act)
{
  QMetaObject::invokeMethod(
      this,
      [this, act = std::move(act), connection = connection_.load()] {
        if (connection == connection_)
          act();
      },
      Qt::QueuedConnection);
}

template <class Service, class Done>
void InteractionClient::call(const std::string& name, Service request, Done done)
{
  const std::string service = space_.toStdString() + "/" + name;
  pool_.start(new Job([this, service, call = std::move(request), done, connection = connection_.load()]() mutable {
    const ServiceReply reply = callService(service, call, kTimeout, give_up_);
    if (connection == connection_)
      post([done, reply, response = call.response] { done(reply.success, reply.error, response); });
  }));
}

void InteractionClient::trigger(const QString& service)
{
  call("experiment_node/" + service.toStdString(), std_srvs::Trigger(),
       [this, service](bool success, const QString& error, const std_srvs::TriggerResponse& response) {
         Q_EMIT answered(service, success && response.success,
                         success ? QString::fromStdString(response.message) : error);
       });
}

void InteractionClient::listControllers()
{
  call("experiment_node/list_controllers", phri_msgs::ListControllers(),
       [this](bool success, const QString& error, const phri_msgs::ListControllersResponse& response) {
         if (success)
           Q_EMIT controllersListed(list(response.experiment), list(response.available));
         else
           Q_EMIT answered("list_controllers", false, error);
       });
}

void InteractionClient::switchController(const QString& controller)
{
  phri_msgs::SwitchController request;
  request.request.controller = controller.toStdString();
  call("experiment_node/switch_controller", request,
       [this](bool success, const QString& error, const phri_msgs::SwitchControllerResponse& response) {
         Q_EMIT answered("switch_controller", success && response.success,
                         success ? QString::fromStdString(response.message) : error);
       });
}

void InteractionClient::rate(int rating)
{
  phri_msgs::Rate request;
  request.request.rating = rating;
  call("session_runner/rate", request,
       [this, rating](bool success, const QString& error, const phri_msgs::RateResponse& response) {
         Q_EMIT rated(rating, success && response.success, success ? QString::fromStdString(response.message) : error);
       });
}

void InteractionClient::setParameters(const Values& parameters)
{
  dynamic_reconfigure::Reconfigure request;
  request.request.config = config(parameters);
  call(
      "experiment_node/set_parameters", request,
      [this, parameters](bool success, const QString& error, const dynamic_reconfigure::ReconfigureResponse& response) {
        Q_EMIT parametersAnswered(parameters, success, values(response.config), error);
      });
}
}  // namespace phri_rviz
