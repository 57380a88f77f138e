#pragma once
#include <map>
#include <memory>
#include <string>
#include <utility>
#include <vector>

#include "phri_sim/collision.hpp"
#include "phri_sim/contact_solver.hpp"
#include "phri_sim/tree_dynamics.hpp"

namespace phri_sim
{
/// A wall, a table, a board: a shape that never moves. Its shape's origin is in the world's frame.
struct StaticShape
{
  std::string name;
  ShapeDescription shape;
  Material material;
};

struct WorldOptions
{
  TreeOptions tree;
  Material material;                          ///< of links not named below
  std::map<std::string, Material> materials;  ///< by link
  /// Pairs (links or static shapes, by name) that never touch.
  std::vector<std::pair<std::string, std::string>> apart;
  /// Bodies of one branch fewer joints apart than this never touch each other: 2 excludes body and parent.
  int joints_between = 2;
  std::vector<std::string> sensors;  ///< fixed joints whose wrench is read at every step
  int max_contacts = 16;             ///< points; the deepest stay, World::dropped() counts the rest
  double stop_stiffness = 2e4;       ///< of joints' end stops [Nm/rad, N/m]
  double stop_damping_ratio = 1.0;   ///< [-]
};

/// One point where two links, or a link and the environment, press on each other.
struct Contact
{
  Eigen::Vector3d point;             ///< in the world [m]
  Eigen::Vector3d normal;            ///< unit, from b to a
  Eigen::Vector3d force;             ///< exerted BY b ON a, in the world, mean over the step [N]
  double depth = 0.0;                ///< before the step [m]; slightly negative: about to touch
  int link_a = -1, link_b = -1;      ///< index in TreeModel::links(); -1: a static shape
  int static_a = -1, static_b = -1;  ///< index in World::statics(); -1: a link
  double normalForce() const { return force.dot(normal); }
};

/// All that moves (one kinematic tree) and all that it may touch, in steps of 1 ms: dynamics by TreeDynamics, distances
/// by CollisionScene, contact and joint end stops by ContactSolver. step() does not allocate, lock or throw. Two worlds
/// built and stepped alike agree to the last bit. Frames: the world's, unless a comment says otherwise.
///
///   world.setState(q, qd);
///   world.addForce(link, point, force);      // the human: anew before every step, gone after it
///   world.step(1e-3, tau);
///   world.contacts(); world.sensorWrench(0);
class World
{
public:
  /// Throws std::invalid_argument (DescriptionError where a description is at fault) listing all errors: unknown names
  /// in the options, materials or shapes out of range.
  World(const std::vector<TreePart>& parts, std::vector<StaticShape> statics = {}, const WorldOptions& options = {});

  const TreeModel& model() const { return *model_; }
  /// Drives, Jacobians and everything else there is to know about the tree.
  TreeDynamics& dynamics() { return dynamics_; }
  const TreeDynamics& dynamics() const { return dynamics_; }
  const std::vector<StaticShape>& statics() const { return statics_; }
  int staticShape(const std::string& name) const;  ///< index; std::out_of_range naming the known ones

  void setState(const VectorRef& q, const VectorRef& qd) noexcept;  ///< time goes on; contacts and readings are cleared
  const Eigen::VectorXd& q() const { return dynamics_.q(); }
  const Eigen::VectorXd& qd() const { return dynamics_.qd(); }
  Eigen::Isometry3d linkPose(int link) const noexcept { return dynamics_.linkPose(link); }
  double time() const { return time_; }  ///< sum of all steps [s]

  /// By another agent ON the link, for the next step only.
  void addForce(int link, const Eigen::Vector3d& point, const Eigen::Vector3d& force) noexcept;
  void addWrench(int link, const Eigen::Vector3d& point, const Vector6& wrench) noexcept;
  void step(double dt, const VectorRef& tau) noexcept;

  // ---- of the last step
  const std::vector<Contact>& contacts() const { return contacts_; }
  int dropped() const { return dropped_; }  ///< contact points without room
  int sweeps() const { return sweeps_; }    ///< of the contact solver; above ContactSolver::kMaxSweeps: not converged
  /// Sum of all contact forces BY the environment and other links ON the link, in the world [N].
  Eigen::Vector3d contactForce(int link) const noexcept;
  /// Exerted BY what lies beyond the i-th sensor ON the near side: in the axes of and about the origin of the sensor
  /// joint's child link. A hand that pushes the tool along +x is read as +x.
  const Vector6& sensorWrench(int i) const { return sensor_wrenches_[std::size_t(i)]; }
  /// Kinetic, of gravity, and in compressed contacts, stops and drives' springs, at the present state [J].
  double energy() noexcept;

private:
  void locate() noexcept;
  void addContacts() noexcept;
  void addStops(double dt) noexcept;
  void readContacts(double dt) noexcept;

  std::shared_ptr<const TreeModel> model_;
  std::vector<StaticShape> statics_;
  int max_rows_;
  TreeDynamics dynamics_;
  CollisionScene collision_;
  ContactSolver solver_;
  int moving_shapes_ = 0;  // they stand first, static shapes last
  std::vector<Proximity> found_;
  std::vector<CompliantContact> compliant_;
  std::vector<Contact> contacts_;
  std::vector<int> sensors_;
  std::vector<Vector6> sensor_wrenches_;
  Eigen::VectorXd now_, after_, impulses_;
  double stop_stiffness_, stop_damping_ratio_;
  double time_ = 0.0;
  int dropped_ = 0, sweeps_ = 0;
};
}  // namespace phri_sim
