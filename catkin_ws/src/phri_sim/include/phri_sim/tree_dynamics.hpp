#pragma once
#include <Eigen/Geometry>
#include <memory>
#include <vector>

#include "phri_sim/tree_model.hpp"

namespace phri_sim
{
using Vector6 = Eigen::Matrix<double, 6, 1>;  ///< linear part (or force) first
using Jacobian = Eigen::Matrix<double, 6, Eigen::Dynamic>;
using VectorRef = Eigen::Ref<const Eigen::VectorXd>;

/// Servo or spring on a joint, implicit in the step, so that it may be as stiff as it likes:
/// stiffness (position - q) + damping (velocity - qd).
struct JointDrive
{
  double stiffness = 0.0;  ///< [Nm/rad, N/m]
  double damping = 0.0;    ///< [Nms/rad, Ns/m]
  double position = 0.0;   ///< [rad, m]
  double velocity = 0.0;   ///< [rad/s, m/s]
};

/// State and dynamics of a TreeModel, with a workspace that is allocated at construction: nothing below allocates,
/// locks or throws. All vectors are in world axes; all points in the world frame [m]; 6-vectors linear part first.
///
/// M(q) qdd + b(q, qd) = tau + tau_joint + sum J^T wrench, with tau_joint = damping, dry friction and drives. M is
/// built by composite rigid bodies plus armature on its diagonal, and factored as L^T D L along the branches of the
/// tree (Featherstone 2008, ch. 6, 8), because contacts need M^-1 J^T for many rows, and the factor is cheap to reuse.
///
/// Dry friction f is damping by the chord f / sqrt(qd^2 + speed^2) of the velocity at the start of the step: it stops
/// joints however light without turning them back, and is off by a share h qdd / qd of itself while they speed up.
///
/// One step of 1 ms, semi-implicit Euler, implicit in tau_joint (velocity at the end of the step):
///   clearWrenches(); addForce(...)...          what the human and other agents exert, at the present poses
///   prepare(h);                                M_h = M + h (damping + friction slope) + drives, factored
///   forwardDynamics(tau);                      acceleration() without contacts
///   clearRows(); addRow(...)...; delassus();   contacts see M_h, too
///   applyImpulses(lambda);                     acceleration() with contacts
///   jointWrench(sensor);                       F/T at the wrist, contacts included
///   integrate();                               qd += h qdd, q += h qd, new poses
class TreeDynamics
{
public:
  explicit TreeDynamics(std::shared_ptr<const TreeModel> model, int max_rows = 24);

  const TreeModel& model() const { return *model_; }
  int dofs() const { return int(q_.size()); }

  // ---- state and kinematics: poses and velocities always belong to q(), qd()
  void setState(const VectorRef& q, const VectorRef& qd) noexcept;
  const Eigen::VectorXd& q() const { return q_; }               ///< [rad, m]
  const Eigen::VectorXd& qd() const { return qd_; }             ///< [rad/s, m/s]
  const Eigen::VectorXd& acceleration() const { return qdd_; }  ///< of the last forwardDynamics [rad/s2, m/s2]
  Eigen::Isometry3d bodyPose(int body) const noexcept;          ///< in the world; body -1: identity
  Eigen::Isometry3d linkPose(int link) const noexcept;          ///< in the world
  Vector6 linkVelocity(int link) const noexcept;                ///< of the link's origin, and angular
  Eigen::Vector3d pointVelocity(int link, const Eigen::Vector3d& point) const noexcept;
  /// d(velocity of the point of the link now at `point`; angular velocity)/d(qd): 6 x dofs, overwritten.
  void jacobian(int link, const Eigen::Vector3d& point, Eigen::Ref<Jacobian> jacobian) const noexcept;
  /// jacobian^T x wrench, about `point`: joint forces [Nm, N] that the wrench on the link amounts to. Overwritten.
  void jointForces(int link, const Eigen::Vector3d& point, const Vector6& wrench,
                   Eigen::Ref<Eigen::VectorXd> tau) const noexcept;

  // ---- wrenches exerted ON links by other agents; kept until cleared
  void clearWrenches() noexcept;
  void addForce(int link, const Eigen::Vector3d& point, const Eigen::Vector3d& force) noexcept;  ///< [N] at `point`
  void addWrench(int link, const Eigen::Vector3d& point, const Vector6& wrench) noexcept;        ///< about `point`
  std::vector<JointDrive>& drives() { return drives_; }  ///< per joint, all zero at first; read by prepare()

  // ---- dynamics
  /// tau of M qdd + b = tau + sum J^T wrench, with armature, without damping, friction and drives.
  void inverseDynamics(const VectorRef& qdd, Eigen::Ref<Eigen::VectorXd> tau) noexcept;
  /// Mass matrix of the present state and its factor, for a step of h [s]; drops all rows. h = 0: nothing implicit,
  /// M_h = M.
  void prepare(double h) noexcept;
  /// After prepare(): acceleration() = M_h^-1 (tau + tau_joint at (q + h qd, qd) - b + sum J^T wrench).
  void forwardDynamics(const VectorRef& tau) noexcept;
  /// After prepare(): x = M_h^-1 x.
  void solve(Eigen::Ref<Eigen::VectorXd> x) const noexcept;
  /// After prepare(): M with armature, without the implicit terms; dense, for tests and controllers.
  void massMatrix(Eigen::Ref<Eigen::MatrixXd> mass) const noexcept;

  // ---- contact rows, after prepare(): row velocity = direction . (velocity of link_a - of link_b) at the point
  void clearRows() noexcept;
  int rows() const { return rows_; }
  int maxRows() const { return int(row_jacobian_.cols()); }
  /// A link of -1 is the world. An impulse pushes link_a along `direction` (unit) and link_b against it. Returns the
  /// row's index, -1 if there is no room.
  int addRow(int link_a, int link_b, const Eigen::Vector3d& point, const Eigen::Vector3d& direction) noexcept;
  /// A joint's end stop: row velocity = sign qd.
  int addJointRow(int joint, double sign) noexcept;
  /// J (dofs x rows, transposed).
  auto rowJacobianTransposed() const { return row_jacobian_.leftCols(rows_); }
  /// J M_h^-1 J^T, rows x rows [1/kg].
  Eigen::Ref<const Eigen::MatrixXd> delassus() noexcept;
  /// J qd now, and J (qd + h acceleration()) as it will be after the step [m/s].
  void rowVelocities(Eigen::Ref<Eigen::VectorXd> now, Eigen::Ref<Eigen::VectorXd> after) const noexcept;
  /// Impulses [Ns] of all rows over the step h: changes acceleration() by M_h^-1 J^T impulses / h, and adds the mean
  /// forces to the links' wrenches, so that jointWrench() sees them. Needs a step h > 0.
  void applyImpulses(const VectorRef& impulses) noexcept;

  // ---- readings
  /// Wrench that passes through a fixed joint: exerted BY the near side ON the far side, in the axes of and about the
  /// origin of the joint's child link. From the momentum balance of all that lies beyond: sum of mass x acceleration
  /// and rate of angular momentum, less gravity, less the wrenches on links beyond. What an F/T sensor reads of a push
  /// by the environment is its negative. Not a number between integrate() and the next forwardDynamics().
  Vector6 jointWrench(int fixed_joint) noexcept;
  /// Of the link's origin (as an accelerometer there moves, gravity not included), and angular [m/s2, rad/s2].
  Vector6 linkAcceleration(int link) noexcept;
  double kineticEnergy() const noexcept;    ///< with armature [J]
  double potentialEnergy() const noexcept;  ///< of gravity: 0 with all mass at the world's origin [J]
  /// Linear [Ns] and angular momentum about `point` [Nms] of all bodies, without rotors.
  Vector6 momentum(const Eigen::Vector3d& point) const noexcept;

  // ---- integration
  /// After forwardDynamics() (and applyImpulses()): qd += h acceleration(), q += h qd with prepare()'s h.
  void integrate() noexcept;
  /// The three calls for a step without contacts.
  void stepEuler(const VectorRef& tau, double h) noexcept;
  /// Classical Runge-Kutta of fourth order, tau and wrenches (about points that move with the links' bodies, in world
  /// axes) constant. Explicit: unstable where h x damping / inertia is beyond 2.7.
  void stepRungeKutta(const VectorRef& tau, double h) noexcept;

private:
  struct Body
  {
    Eigen::Matrix3d rotation;                         // in the world; column 2 is the joint's axis
    Eigen::Vector3d origin, arm;                      // in the world; and less the parent's
    Eigen::Vector3d velocity, spin;                   // of the origin; angular
    Eigen::Vector3d bias, bias_spin;                  // acceleration at qdd = 0 of a parent that does not accelerate
    Eigen::Vector3d acceleration, spin_acceleration;  // of the origin; angular
    Eigen::Vector3d force, torque;                    // about the origin, like the next: scratch of the recursions
    Eigen::Vector3d applied_force, applied_torque;    // sum over the body's links
    Eigen::Vector3d moment;                           // mass x centre of mass
    Eigen::Matrix3d inertia;
    double composite_mass;  // of the body and all that it carries, like the next two
    Eigen::Vector3d composite_moment;
    Eigen::Matrix3d composite_inertia;
  };
  struct Wrench
  {
    Eigen::Vector3d force, torque;  // about the origin of the link's body
  };
  struct Row
  {
    int link_a, link_b;
    Eigen::Vector3d point, direction;
    int support;  // entries of the row's Jacobian beyond this many are zero
  };

  const Body& bodyOf(int link) const { return bodies_[std::size_t(model_->links()[std::size_t(link)].body + 1)]; }
  void updateKinematics() noexcept;
  void accelerate(const double* qdd, const Eigen::Vector3d& root) noexcept;
  void gatherForces(double* tau) noexcept;
  void buildMassMatrix() noexcept;
  void factor() noexcept;
  void solveTransposed(double* x, int support) const noexcept;
  void addForceAlong(int body, const Eigen::Vector3d& point, const Eigen::Vector3d& force,
                     const Eigen::Vector3d& torque, double* tau) const noexcept;
  int finishRow(const Row& row) noexcept;
  void requireAccelerations() noexcept;

  std::shared_ptr<const TreeModel> model_;
  std::vector<Body> bodies_;      // [0] is the world, [i + 1] moves with degree of freedom i
  std::vector<Wrench> wrenches_;  // per link
  std::vector<JointDrive> drives_;
  Eigen::VectorXd q_, qd_, qdd_, scratch_;
  Eigen::VectorXd start_q_, start_qd_, sum_q_, sum_qd_;  // of Runge-Kutta
  double step_ = 0.0;                                    // of the last prepare()
  bool accelerated_ = false;                             // acceleration() belongs to q(), qd()
  bool stale_ = true;                                    // the bodies' accelerations do not belong to acceleration()

  // M and its factor, sparse along the tree: row i holds its ancestors from the root on, and itself last
  std::vector<int> begin_, depth_, ancestors_;
  Eigen::VectorXd mass_, factor_, inverse_pivot_, implicit_, joint_force_;

  Eigen::MatrixXd row_jacobian_, row_factor_, delassus_;  // J^T; D^-1/2 L^-T J^T; its square
  std::vector<Row> row_;
  int rows_ = 0;
};
}  // namespace phri_sim
