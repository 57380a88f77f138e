#pragma once
/// Reproduction of a demonstrated contact task under a displaced environment (5.4). The tool is rendered as
///
///   M_r xdd + D_r xd = u_p + u_f,     u_f = K_f (f_env - mu_f)                                     (5.45), (5.46)
///
/// f_env is the wrench exerted BY the environment ON the tool, as the force/torque sensor measures it (it pushes back:
/// a tool that presses down reads a positive z), and mu_f the learned mean of the same quantity; the thesis' (5.46)
/// has the opposite sign, for its force is the tool's on the environment. The motion control u_p follows the learned
/// trajectory and takes u_f for noise: u_f ~ N(u_0, Sigma_u) enters like a control, xi+ = A xi + B (u_p + eps) (5.48),
///
///   Sigma_u,k = max(Sigma_f,k expected by the model, moment of u_f over the last `window` seconds)
///   J = 1/2 sum_k (xi_k - xi_d,k)'Q_k(xi_k - xi_d,k) + R u_k^2,  criterion V(theta): theta < 0 is risk-seeking
///
/// and yields (lower gains) where u_f is active if risk-seeking. The axes are decoupled: one problem of two states
/// each. u_0 is the mean of u_f in the window, "about zero" its second moment, "about u_0" its covariance.
///
///   neutral_learned     (a)  theta = 0, xi_d = mu
///   seeking_learned     (b)  theta = -seeking, xi_d = mu, about zero
///   neutral_adapted     (c)  theta = 0, xi_d = mu + xi_a, xi_a+ = A xi_a + B u_0 (5.51)
///   seeking_adapted     (d)  both, about u_0. A has the eigenvalue 1: what was adapted stays
///   seeking_forgetting  (e)  (d) with xi_a+ = lambda A xi_a + B u_0, lambda = exp(-dt / forgetting_time); about
///                            zero, as a reference that forgets u_0 does not account for all of it
///   neutral_forgetting       (c) with that leak: tells the part of the leak in (e) from that of theta
///   averse_learned           theta = +averse, as (b); stiffens, for motion without intended contact
///
/// ## In the interaction loop
/// The policies are for an InteractionLoop that renders K_f^-1 M_r, K_f^-1 D_r (5.4.1; loopMass, loopDamping). There
///
///   (K_f^-1 M_r) xdd + (K_f^-1 D_r) xd = f_env + [K_f^-1 u_p - mu_f(t)]
///
/// is (5.45): the measured f_env goes into Measurement::environment_wrench at 1 kHz, human_wrench is 0 (nobody holds
/// the tool), and the bracket is the policy's u_r, with -mu_f in the feedforward. So u_f acts at 1 kHz without any
/// further term. The loop needs `autonomous_completion` (no hand to let go), and its age guard watches the wrench
/// sample through receive_ns, sequence and stamp_ns: fill them from the sensor's sample.
///
/// Trap: range and age guard human_wrench only. A device with a stale or saturated sensor must stop counting sequence
/// (the loop faults) and set environment_wrench to NaN (the loop takes 0), else the last value goes on pushing.

#include <optional>
#include <string>
#include <vector>

#include "phri_control/assistance_settings.hpp"
#include "phri_control/feedback_policy.hpp"
#include "phri_control/force_variability.hpp"
#include "phri_control/risk_limits.hpp"
#include "phri_core/interaction.hpp"

namespace phri_control
{
/// A learned task: element k of both lists speaks of time t0 + k dt on the observations' clock. Between the elements
/// means and covariances are interpolated linearly; before the first one that one holds, after the last one that one
/// holds at rest. May be the whole task, or a horizon of it that is renewed.
struct ContactReference
{
  double t0 = 0.0;                                      ///< [s]
  double dt = 0.0;                                      ///< [s]
  std::vector<phri_core::Gaussian> motion;              ///< xi = [x; xdot] (2 dof) [m; m/s]
  std::vector<phri_core::Gaussian> environment_wrench;  ///< (dof) [N] by the environment on the tool
};

/// Mass, damping and window of the thesis' experiment; weights, theta and floor are ours (the thesis gives none that
/// can be used: docs/contact.md).
struct ContactSettings
{
  phri_core::VectorDof mass = Eigen::Vector3d::Constant(10.0);       ///< M_r [kg], diagonal, 1..6 axes
  phri_core::VectorDof damping = Eigen::Vector3d::Constant(80.0);    ///< D_r [Ns/m]
  phri_core::VectorDof force_gain = Eigen::Vector3d::Constant(1.0);  ///< K_f [-], diagonal, > 0

  double dt = 1e-3;       ///< [s] of a stage; weights and theta are per sample, so both depend on it
  double horizon = 0.5;   ///< [s] of the optimisation
  double validity = 0.2;  ///< [s] of it that a policy contains; the loop fades to passive after that
  /// "error_feedback" (the thesis, (5.53)): u_p = L (xi - xi_d). "preview" adds the optimal feedforward.
  std::string law = "error_feedback";
  /// "covariance": Q = diag of `covariance_weights` / (variance of the motion on that axis + floor). "identity": Q =
  /// diag of `identity_weights`.
  std::string weighting = "covariance";
  StateWeights covariance_weights{ 25.0, 0.0 };  ///< [-]: about sqrt(25) = 5 N per standard deviation
  StateWeights identity_weights{ 2.5e5, 0.0 };   ///< [1/m^2; s^2/m^2]: about sqrt(2.5e5) = 500 N/m
  double covariance_floor = 1e-4;                ///< [m^2; m^2/s^2] bounds the gain: 1 cm is the least spread
  double control_weight = 1.0;                   ///< R [1/N^2]
  double seeking = 10.0;             ///< -theta of the seeking ones [1/J]; with R = 1/N^2, per N^2 of variance of u_f
  double averse = 0.05;              ///< theta of the averse one; beyond about 1/(R Sigma_u) there is no policy
  double window = 0.3;               ///< W [s]
  double forgetting_time = 1.0;      ///< [s] of the leak
  bool clamp_velocity_gain = false;  ///< D = 0 of 5.4.3: stiffness only, the optimal velocity gain is left out
};

/// Key, unit and range of every setting but mass, damping and force_gain.
phri_core::ParameterTable parameterTable(ContactSettings& settings);

/// Throws std::invalid_argument naming the setting, its value, unit and range.
void requireValid(ContactSettings settings);

/// What a plan did, for records and analysis; first stage, per axis.
struct ContactPlan
{
  double t = 0.0;                              ///< [s]
  phri_core::VectorDof bias;                   ///< u_0 [N]
  phri_core::VectorDof noise_variance;         ///< diagonal of Sigma_u [N^2]
  phri_core::VectorDof stiffness;              ///< K [N/m], of u_p
  phri_core::VectorDof velocity_gain;          ///< D [Ns/m], of u_p
  phri_core::VectorState adaptation;           ///< xi_a [m; m/s]
  phri_core::VectorState reference;            ///< xi_d = mu + xi_a [m; m/s]
  RiskFallback fallback = RiskFallback::None;  ///< the furthest of all axes
  double scale = 1.0;                          ///< of an averse theta, the smallest of all axes
};

/// `observe` as often as there are samples, `plan` at 50 Hz or faster, both from one thread. `observe` allocates
/// nothing. Without calls of `observe` a plan's own observation is the only sample of its period.
class ContactController
{
public:
  /// Throws std::invalid_argument for an unknown name (listing the known ones) or a setting out of range.
  ContactController(const std::string& name, const ContactSettings& settings);

  /// The task to follow from now on; window and adaptation are kept. Throws std::invalid_argument naming the element
  /// that is not finite, of the wrong size, or not a covariance.
  void follow(const ContactReference& reference);

  /// Forgets window and adaptation: the start of another trial.
  void reset() noexcept;

  /// A sample of the wrench by the environment on the tool at time t [s]. Ignored unless there is a task to follow, and
  /// as ForceWindow::add.
  void observe(double t, const phri_core::VectorDof& environment_wrench) noexcept;

  /// A policy from observation.t on; nothing, see `failure`, without a task, for an observation that is not finite or
  /// of the wrong size or before the last one, or when no policy exists. xi_a goes on by the bias of the plan before,
  /// as that one's references did: they have no step from plan to plan.
  std::optional<FeedbackPolicy> plan(const phri_core::Observation& observation);

  /// u_f [N] at time t for a measured wrench; 0 without a task.
  phri_core::VectorDof forceInput(double t, const phri_core::VectorDof& environment_wrench) const noexcept;

  const std::string& name() const { return name_; }
  const std::string& failure() const { return failure_; }
  /// Of the last plan that gave a policy.
  const ContactPlan& last() const { return last_; }
  /// Of the InteractionLoop: K_f^-1 M_r [kg], K_f^-1 D_r [Ns/m].
  phri_core::VectorDof loopMass() const { return settings_.mass.cwiseQuotient(settings_.force_gain); }
  phri_core::VectorDof loopDamping() const { return settings_.damping.cwiseQuotient(settings_.force_gain); }

private:
  using Problem = LinearQuadraticProblem<2, 1>;

  /// Element of the reference, with what is needed of its covariances; also an interpolated one.
  struct Node
  {
    phri_core::VectorState mean, variance;
    phri_core::VectorDof force;
    MatrixDof force_covariance;
    phri_core::VectorDof noise;  // diagonal of Sigma_u; set by a plan
  };

  /// Two neighbours in the reference and the share of the second.
  struct Place
  {
    const Node *first, *second;
    double share;
    bool past;  ///< beyond the last element

    template <typename Vector>
    Vector operator()(Vector Node::*member) const
    {
      return first->*member + share * (second->*member - first->*member);
    }
    template <typename Vector>
    double operator()(Vector Node::*member, Eigen::Index i) const
    {
      return (first->*member)(i) + share * ((second->*member)(i) - (first->*member)(i));
    }
  };

  Place locate(double t) const noexcept;  // precondition: there is a task
  std::string unusable(const phri_core::Observation& observation) const;
  void adapt(phri_core::VectorState& adaptation) const noexcept;  // one step of dt
  void setReferences(double t);
  void setNoise(double t, const MatrixDof& observed);
  void setAxis(Eigen::Index axis, double t);

  std::string name_, failure_;
  ContactSettings settings_;
  int source_ = 0;
  double theta_ = 0.0, lambda_ = 1.0;
  bool adapts_ = false;

  double reference_t0_ = 0.0, reference_dt_ = 1.0;
  std::vector<Node> nodes_;
  ForceWindow window_;
  phri_core::VectorDof bias_;          // u_0 of the last plan
  phri_core::VectorState adaptation_;  // xi_a at the time of the last plan
  double planned_at_ = 0.0;
  bool planned_ = false;
  std::vector<Problem> problems_;                   // per axis
  std::vector<phri_core::VectorState> references_;  // xi_d of the stages and of the end
  RiskSolution<2, 1> solution_;
  ContactPlan last_;
};

/// Names of the controllers, in the order above; policies carry the index as source.
const std::vector<std::string>& contactControllerNames();
}  // namespace phri_control
