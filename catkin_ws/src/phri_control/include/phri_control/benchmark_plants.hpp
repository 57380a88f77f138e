#pragma once
/// The plants of the evaluations 4.6.2 and 4.6.3 in continuous time, xdot = f(x, u), with exact first derivatives, and
/// their discretisation x+ = F(x, u) with exact derivatives A = dF/dx, B = dF/du. All move in a horizontal plane, and
/// all have the same task output y(x) = [position (2) [m]; velocity (2) [m/s]] in the plane, with exact first and
/// second derivatives: costs are functions of outputs, so that one cost serves every plant.
///
/// A plant moved with u = 0 is a passive goal or obstacle. Nothing here allocates after construction. Constructors
/// throw std::invalid_argument for parameters that no physical plant has.

#include <Eigen/Core>
#include <optional>

namespace phri_control
{
constexpr int kMaxPlantState = 5;
using PlantState = Eigen::Matrix<double, Eigen::Dynamic, 1, 0, kMaxPlantState, 1>;
using PlantMatrix = Eigen::Matrix<double, Eigen::Dynamic, Eigen::Dynamic, 0, kMaxPlantState, kMaxPlantState>;
using PlantInput = Eigen::Matrix<double, Eigen::Dynamic, 2, 0, kMaxPlantState, 2>;
using MotionJacobian = Eigen::Matrix<double, 4, Eigen::Dynamic, 0, 4, kMaxPlantState>;

class Plant
{
public:
  virtual ~Plant() = default;
  /// Size n of the state; every plant has 2 controls.
  virtual Eigen::Index stateSize() const = 0;
  /// xdot = f(x, u).
  virtual void rate(const PlantState& x, const Eigen::Vector2d& u, PlantState& xdot) const = 0;
  /// fx = df/dx (n, n), fu = df/du (n, 2).
  virtual void rateJacobians(const PlantState& x, const Eigen::Vector2d& u, PlantMatrix& fx, PlantInput& fu) const = 0;

  /// y(x) = [position; velocity].
  virtual Eigen::Vector4d motion(const PlantState& x) const = 0;
  /// dy/dx (4, n).
  virtual void motionJacobian(const PlantState& x, MotionJacobian& jacobian) const = 0;
  /// hessian += sum_i weight_i d2 y_i / dx2: what the bending of the output adds to the Hessian of a cost with gradient
  /// `weight` in y. (n, n).
  virtual void addMotionCurvature(const PlantState& x, const Eigen::Vector4d& weight, PlantMatrix& hessian) const = 0;
  /// y = x and its derivatives are constant.
  virtual bool motionIsState() const { return false; }
};

enum class Integrator
{
  Euler,       ///< x + dt f(x, u), as in the thesis: A = I + dt f_x, B = dt f_u
  RungeKutta4  ///< the classical one, u held over the step
};

/// x+ after dt [s]; u is held.
void step(const Plant& plant, Integrator integrator, double dt, const PlantState& x, const Eigen::Vector2d& u,
          PlantState& next);
/// A = dx+/dx, B = dx+/du: the exact derivatives of `step`, not a discretisation of their own.
void linearise(const Plant& plant, Integrator integrator, double dt, const PlantState& x, const Eigen::Vector2d& u,
               PlantMatrix& A, PlantInput& B);

/// Force field in which the driven goal and obstacle of figures 4.7 and 4.8 move: [cos(k p1), sin(k p2)] [N].
struct DrivingForce
{
  double wavenumber = 0.0;  ///< k [rad/m]
};

/// M pdd + D pd = u [+ drive], x = [p; pd] [m; m/s], u [N].
class PointMass : public Plant
{
public:
  /// mass [kg] > 0 and damping [Ns/m] >= 0 of each axis.
  explicit PointMass(const Eigen::Vector2d& mass = Eigen::Vector2d::Ones(),
                     const Eigen::Vector2d& damping = Eigen::Vector2d::Ones(),
                     std::optional<DrivingForce> drive = std::nullopt);
  Eigen::Index stateSize() const override { return 4; }
  void rate(const PlantState& x, const Eigen::Vector2d& u, PlantState& xdot) const override;
  void rateJacobians(const PlantState& x, const Eigen::Vector2d& u, PlantMatrix& fx, PlantInput& fu) const override;
  Eigen::Vector4d motion(const PlantState& x) const override { return x; }
  void motionJacobian(const PlantState& x, MotionJacobian& jacobian) const override;
  void addMotionCurvature(const PlantState&, const Eigen::Vector4d&, PlantMatrix&) const override {}
  bool motionIsState() const override { return true; }

  const Eigen::Vector2d& mass() const { return mass_; }
  const Eigen::Vector2d& damping() const { return damping_; }
  const std::optional<DrivingForce>& drive() const { return drive_; }

private:
  Eigen::Vector2d mass_, inverse_mass_, damping_;
  std::optional<DrivingForce> drive_;
};

/// What the two controls of the arm are.
enum class ArmInput
{
  JointTorque,    ///< tau = u [Nm]
  WorkspaceForce  ///< tau = J(q)'u, u [N] at the end-effector: the thesis' "joint torques in workspace coordinates"
};

/// Two links in the horizontal plane; defaults of section 4.6.3. The second joint's angle is relative to the first
/// link.
struct ArmParameters
{
  Eigen::Vector2d mass{ 1.4, 1.1 };         ///< [kg] m1, m2
  Eigen::Vector2d length{ 0.3, 0.33 };      ///< [m] l1, l2; centres of mass at l/2
  Eigen::Vector2d inertia{ 0.025, 0.045 };  ///< [kg m^2] about each link's own JOINT, not its centre of mass
  Eigen::Matrix2d friction = (Eigen::Matrix2d() << 0.05, 0.025, 0.025, 0.05).finished();  ///< B [Nms/rad]
};

/// M(q) qdd + C(q, qd) + B qd = tau, x = [q; qd] [rad; rad/s]. With a1 = I1 + I2 + m2 l1^2, a2 = m2 l1 l2 / 2, a3 = I2:
/// M = [a1 + 2 a2 c2, a3 + a2 c2; a3 + a2 c2, a3], C = a2 s2 [-qd2 (2 qd1 + qd2); qd1^2]. m1 does not act by itself: it
/// is in I1.
class TwoLinkArm : public Plant
{
public:
  explicit TwoLinkArm(const ArmParameters& parameters = ArmParameters(), ArmInput input = ArmInput::JointTorque);
  Eigen::Index stateSize() const override { return 4; }
  void rate(const PlantState& x, const Eigen::Vector2d& u, PlantState& xdot) const override;
  void rateJacobians(const PlantState& x, const Eigen::Vector2d& u, PlantMatrix& fx, PlantInput& fu) const override;
  Eigen::Vector4d motion(const PlantState& x) const override;
  void motionJacobian(const PlantState& x, MotionJacobian& jacobian) const override;
  void addMotionCurvature(const PlantState& x, const Eigen::Vector4d& weight, PlantMatrix& hessian) const override;

  Eigen::Matrix2d massMatrix(const Eigen::Vector2d& q) const;
  Eigen::Vector2d endEffector(const Eigen::Vector2d& q) const;
  Eigen::Matrix2d jacobian(const Eigen::Vector2d& q) const;  ///< d endEffector / dq [m/rad]
  /// 1/2 qd'M qd [J]: constant without friction and control.
  double kineticEnergy(const PlantState& x) const;
  /// The state with the end-effector at `motion` = [p; pd] and 0 < q2 < pi (the elbow to the right of the line from the
  /// shoulder to the hand). Throws std::invalid_argument where the arm does not reach or is singular.
  PlantState stateAt(const Eigen::Vector4d& motion) const;
  const ArmParameters& parameters() const { return parameters_; }

private:
  ArmParameters parameters_;
  double a1_, a2_, a3_;
  ArmInput input_;
};

/// (4.46): x = [p1 [m], p2 [m], heading [rad], speed [m/s], curvature [1/m]], u = [acceleration [m/s^2], rate of
/// curvature [1/(m s)]]: pd = v [cos, sin](heading), heading' = v c, v' = u1, c' = u2.
class CarLikeRobot : public Plant
{
public:
  Eigen::Index stateSize() const override { return 5; }
  void rate(const PlantState& x, const Eigen::Vector2d& u, PlantState& xdot) const override;
  void rateJacobians(const PlantState& x, const Eigen::Vector2d& u, PlantMatrix& fx, PlantInput& fu) const override;
  Eigen::Vector4d motion(const PlantState& x) const override;
  void motionJacobian(const PlantState& x, MotionJacobian& jacobian) const override;
  void addMotionCurvature(const PlantState& x, const Eigen::Vector4d& weight, PlantMatrix& hessian) const override;
};
}  // namespace phri_control
