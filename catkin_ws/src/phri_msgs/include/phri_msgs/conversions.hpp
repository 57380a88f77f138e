#pragma once
/// Pure conversions between messages and the types of phri_core. Nothing is rounded: numbers cross bit for bit. Headers
/// are the caller's, except that `frame_id` of what is read is not looked at here.

#include <phri_msgs/Observation.h>
#include <phri_msgs/Prediction.h>

#include <Eigen/Core>
#include <optional>
#include <stdexcept>
#include <string>
#include <vector>

#include "phri_core/interaction.hpp"

namespace phri_msgs
{
namespace detail
{
using RowMajor = Eigen::Matrix<double, Eigen::Dynamic, Eigen::Dynamic, Eigen::RowMajor>;

inline void append(const std::vector<phri_core::Gaussian>& gaussians, std::vector<double>& mean,
                   std::vector<double>& covariance)
{
  for (const phri_core::Gaussian& gaussian : gaussians)
  {
    mean.insert(mean.end(), gaussian.mean.data(), gaussian.mean.data() + gaussian.mean.size());
    const RowMajor rows = gaussian.covariance;
    covariance.insert(covariance.end(), rows.data(), rows.data() + rows.size());
  }
}

inline std::vector<phri_core::Gaussian> split(const std::string& name, const std::vector<double>& mean,
                                              const std::vector<double>& covariance, std::size_t size)
{
  const std::size_t count = size == 0 ? 0 : mean.size() / size;
  if (mean.size() != count * size || covariance.size() != count * size * size)
    throw std::invalid_argument("Prediction: " + name + " has " + std::to_string(mean.size()) + " means and " +
                                std::to_string(covariance.size()) + " covariances: expected K x " +
                                std::to_string(size) + " and K x " + std::to_string(size) + "^2");
  std::vector<phri_core::Gaussian> gaussians(count);
  for (std::size_t k = 0; k < count; ++k)
  {
    gaussians[k].mean = Eigen::Map<const Eigen::VectorXd>(mean.data() + k * size, size);
    gaussians[k].covariance = Eigen::Map<const RowMajor>(covariance.data() + k * size * size, size, size);
  }
  return gaussians;
}

template <typename Vector>
std::vector<double> toList(const Vector& vector)
{
  return std::vector<double>(vector.data(), vector.data() + vector.size());
}

template <typename Vector>
Vector fromList(const std::string& name, const std::vector<double>& list, std::size_t limit)
{
  if (list.size() > limit)
    throw std::invalid_argument("Observation: " + name + " has " + std::to_string(list.size()) +
                                " elements: expected at most " + std::to_string(limit));
  return Eigen::Map<const Eigen::VectorXd>(list.data(), list.size());
}
}  // namespace detail

/// Features are not part of the message.
inline Observation toMessage(const phri_core::Observation& observation)
{
  Observation message;
  message.t = observation.t;
  message.state = detail::toList(observation.state);
  message.human_wrench = detail::toList(observation.human_wrench);
  message.environment_wrench = detail::toList(observation.environment_wrench);
  return message;
}

/// Throws std::invalid_argument naming the list that is longer than a rigid body allows.
inline phri_core::Observation fromMessage(const Observation& message)
{
  phri_core::Observation observation;
  observation.t = message.t;
  observation.state = detail::fromList<phri_core::VectorState>("state", message.state, 2 * phri_core::kMaxDof);
  observation.human_wrench =
      detail::fromList<phri_core::VectorDof>("human_wrench", message.human_wrench, phri_core::kMaxDof);
  observation.environment_wrench =
      detail::fromList<phri_core::VectorDof>("environment_wrench", message.environment_wrench, phri_core::kMaxDof);
  return observation;
}

inline Prediction toMessage(const phri_core::Prediction& prediction)
{
  Prediction message;
  message.t0 = prediction.t0;
  message.dt = prediction.dt;
  message.model = prediction.model;
  message.state_size = prediction.desired_state.empty() ? 0 : prediction.desired_state.front().mean.size();
  message.wrench_size = prediction.human_wrench.empty() ? 0 : prediction.human_wrench.front().mean.size();
  detail::append(prediction.desired_state, message.mean, message.covariance);
  detail::append(prediction.human_wrench, message.wrench_mean, message.wrench_covariance);
  return message;
}

/// Nothing where the model cannot tell (no element). Throws std::invalid_argument naming the list whose length is
/// wrong.
inline std::optional<phri_core::Prediction> fromMessage(const Prediction& message)
{
  phri_core::Prediction prediction;
  prediction.t0 = message.t0;
  prediction.dt = message.dt;
  prediction.model = message.model;
  prediction.desired_state = detail::split("mean", message.mean, message.covariance, message.state_size);
  prediction.human_wrench =
      detail::split("wrench_mean", message.wrench_mean, message.wrench_covariance, message.wrench_size);
  if (prediction.desired_state.empty())
    return std::nullopt;
  if (!prediction.human_wrench.empty() && prediction.human_wrench.size() != prediction.desired_state.size())
    throw std::invalid_argument("Prediction: wrench_mean speaks of " + std::to_string(prediction.human_wrench.size()) +
                                " times: expected as many as mean, " + std::to_string(prediction.desired_state.size()) +
                                ", or none");
  return prediction;
}
}  // namespace phri_msgs
