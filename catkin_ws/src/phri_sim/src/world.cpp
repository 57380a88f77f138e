#include "phri_sim/world.hpp"

#include <algorithm>
#include <cmath>
#include <set>
#include <stdexcept>

namespace phri_sim
{
namespace
{
constexpr double kMaxStiffness = 1e6;  // [N/m]
constexpr int kMaxContacts = 256;
constexpr double kNearStop = 0.5e-3;  // distance at which an end stop becomes a row [rad, m]

void checkMaterial(const Material& m, const std::string& whose, std::vector<std::string>& errors)
{
  const auto check = [&](double value, double low, double high, const std::string& what, const std::string& unit) {
    if (!(value >= low && value <= high))
      errors.push_back("material of " + whose + ": " + what + " " + std::to_string(value) + " " + unit + "; expected " +
                       std::to_string(low) + " to " + std::to_string(high));
  };
  check(m.stiffness, 1.0, kMaxStiffness, "stiffness", "N/m");
  check(m.damping_ratio, 0.0, 10.0, "damping ratio", "-");
  check(m.friction, 0.0, 10.0, "friction", "-");
}

void checkShape(const StaticShape& s, std::vector<std::string>& errors)
{
  const int sizes = s.shape.kind == ShapeKind::Box ? 3 : s.shape.kind == ShapeKind::Cylinder ? 2 : 1;
  if (!s.shape.size.head(sizes).allFinite() || !(s.shape.size.head(sizes).minCoeff() > 0.0))
    errors.push_back("static shape " + s.name + ": sizes must be positive and finite [m]");
  if (!s.shape.origin.matrix().allFinite())
    errors.push_back("static shape " + s.name + ": its pose is not finite");
}

/// Which part of the world a link belongs to, by name.
std::map<std::string, int> partsOfLinks(const std::vector<TreePart>& parts)
{
  std::map<std::string, int> part_of;
  for (int part = 0; part < int(parts.size()); ++part)
  {
    for (const LinkDescription& link : parts[std::size_t(part)].description.links)
      part_of[link.name] = part;
  }
  return part_of;
}

/// Joints between two bodies of which one carries the other (-1: the world carries all); -1 if neither does.
int jointsBetween(const TreeModel& model, int a, int b)
{
  if (a < b)
    std::swap(a, b);
  int joints = 0;
  for (; a > b; ++joints)
    a = model.bodies()[std::size_t(a)].parent;
  return a == b ? joints : -1;
}

struct Filter
{
  const TreeModel& model;
  std::map<std::string, int> part_of;
  std::set<std::pair<std::string, std::string>> apart;
  int joints_between;

  bool mayTouch(const CollisionShape& a, const std::string& name_a, const CollisionShape& b,
                const std::string& name_b) const
  {
    const int body_a = a.link < 0 ? -1 : model.links()[std::size_t(a.link)].body;
    const int body_b = b.link < 0 ? -1 : model.links()[std::size_t(b.link)].body;
    if (body_a == body_b || apart.count({ name_a, name_b }) || apart.count({ name_b, name_a }))
      return false;
    if (a.link < 0 || b.link < 0)
      return true;
    if ((body_a < 0 || body_b < 0) && part_of.at(name_a) != part_of.at(name_b))
      return true;  // both hang on the world, but not on each other
    const int joints = jointsBetween(model, body_a, body_b);
    return joints < 0 || joints >= joints_between;
  }
};

std::vector<CollisionShape> collectShapes(const TreeModel& model, const std::vector<StaticShape>& statics,
                                          const WorldOptions& options)
{
  std::vector<CollisionShape> shapes;
  for (int link = 0; link < int(model.links().size()); ++link)
  {
    const TreeLink& l = model.links()[std::size_t(link)];
    const auto own = options.materials.find(l.name);
    for (const ShapeDescription& shape : l.collision)
      shapes.push_back({ shape, link, own == options.materials.end() ? options.material : own->second });
  }
  for (const StaticShape& s : statics)
    shapes.push_back({ s.shape, -1, s.material });
  return shapes;
}

CollisionScene makeScene(const TreeModel& model, const std::vector<TreePart>& parts,
                         const std::vector<StaticShape>& statics, const WorldOptions& options)
{
  std::vector<std::string> errors;
  std::set<std::string> names;
  for (const TreeLink& link : model.links())
    names.insert(link.name);
  for (const StaticShape& s : statics)
  {
    if (!names.insert(s.name).second)
      errors.push_back("static shape " + s.name + ": the name is used twice");
    checkShape(s, errors);
    checkMaterial(s.material, s.name, errors);
  }
  checkMaterial(options.material, "links (default)", errors);
  const auto checkName = [&](const std::string& name, const std::string& where) {
    if (!names.count(name))
      errors.push_back(where + ": no link or static shape is called '" + name + "'");
  };
  for (const auto& [name, material] : options.materials)
  {
    checkName(name, "materials");
    checkMaterial(material, name, errors);
  }
  for (const auto& [a, b] : options.apart)
  {
    checkName(a, "apart");
    checkName(b, "apart");
  }
  if (options.max_contacts < 1 || options.max_contacts > kMaxContacts)
    errors.push_back("max_contacts " + std::to_string(options.max_contacts) + "; expected 1 to " +
                     std::to_string(kMaxContacts));
  if (!(options.stop_stiffness > 0.0) || !(options.stop_damping_ratio >= 0.0))
    errors.push_back("end stops: stiffness must be positive and damping ratio at least 0");
  if (!errors.empty())
    throw DescriptionError("world", errors);

  std::vector<CollisionShape> shapes = collectShapes(model, statics, options);
  const std::size_t moving = shapes.size() - statics.size();
  const Filter filter{
    model, partsOfLinks(parts), { options.apart.begin(), options.apart.end() }, options.joints_between
  };
  const auto name = [&](std::size_t i) -> const std::string& {
    return i < moving ? model.links()[std::size_t(shapes[i].link)].name : statics[i - moving].name;
  };
  std::vector<std::pair<int, int>> pairs;
  for (std::size_t a = 0; a < shapes.size(); ++a)
  {
    for (std::size_t b = a + 1; b < shapes.size(); ++b)
    {
      if (filter.mayTouch(shapes[a], name(a), shapes[b], name(b)))
        pairs.emplace_back(int(a), int(b));
    }
  }
  return CollisionScene(std::move(shapes), pairs);
}
}  // namespace

World::World(const std::vector<TreePart>& parts, std::vector<StaticShape> statics, const WorldOptions& options)
  : model_(std::make_shared<TreeModel>(parts, options.tree)),
    statics_(std::move(statics)),
    max_rows_(3 * std::clamp(options.max_contacts, 1, kMaxContacts) + 2 * model_->dofs()),
    dynamics_(model_, max_rows_),
    collision_(makeScene(*model_, parts, statics_, options)),
    solver_(max_rows_),
    stop_stiffness_(options.stop_stiffness),
    stop_damping_ratio_(options.stop_damping_ratio)
{
  moving_shapes_ = int(collision_.shapes().size() - statics_.size());
  for (const std::string& sensor : options.sensors)
    sensors_.push_back(model().fixedJoint(sensor));
  sensor_wrenches_.assign(sensors_.size(), Vector6::Zero());
  found_.reserve(std::size_t(options.max_contacts));
  contacts_.reserve(std::size_t(options.max_contacts));
  compliant_.reserve(std::size_t(max_rows_));
  now_ = after_ = impulses_ = Eigen::VectorXd::Zero(max_rows_);
  for (int shape = 0; shape < int(collision_.shapes().size()); ++shape)
    collision_.setPose(shape, Eigen::Isometry3d::Identity());
}

int World::staticShape(const std::string& name) const
{
  std::string known;
  for (std::size_t i = 0; i < statics_.size(); ++i)
  {
    if (statics_[i].name == name)
      return int(i);
    known += " " + statics_[i].name;
  }
  throw std::out_of_range("no static shape is called '" + name + "'; known:" + known);
}

void World::setState(const VectorRef& q, const VectorRef& qd) noexcept
{
  dynamics_.setState(q, qd);
  contacts_.clear();
  for (Vector6& wrench : sensor_wrenches_)
    wrench.setZero();
  dropped_ = sweeps_ = 0;
}

void World::addForce(int link, const Eigen::Vector3d& point, const Eigen::Vector3d& force) noexcept
{
  dynamics_.addForce(link, point, force);
}

void World::addWrench(int link, const Eigen::Vector3d& point, const Vector6& wrench) noexcept
{
  dynamics_.addWrench(link, point, wrench);
}

void World::step(double dt, const VectorRef& tau) noexcept
{
  locate();
  dropped_ = collision_.detect(found_);
  dynamics_.prepare(dt);
  dynamics_.forwardDynamics(tau);
  dynamics_.clearRows();
  compliant_.clear();
  addContacts();
  addStops(dt);
  sweeps_ = 0;
  const int rows = dynamics_.rows();
  if (rows > 0)
  {
    dynamics_.rowVelocities(now_.head(rows), after_.head(rows));
    sweeps_ = solver_.solve(dt, dynamics_.delassus(), compliant_, after_.head(rows), impulses_.head(rows));
    dynamics_.applyImpulses(impulses_.head(rows));
  }
  readContacts(dt);
  for (std::size_t i = 0; i < sensors_.size(); ++i)
    sensor_wrenches_[i] = -dynamics_.jointWrench(sensors_[i]);
  dynamics_.integrate();
  dynamics_.clearWrenches();
  time_ += dt;
}

void World::locate() noexcept
{
  for (int shape = 0; shape < moving_shapes_; ++shape)
    collision_.setPose(shape, dynamics_.linkPose(collision_.shapes()[std::size_t(shape)].link));
}

void World::addContacts() noexcept
{
  for (const Proximity& p : found_)
  {
    const CollisionShape& a = collision_.shapes()[std::size_t(p.shape_a)];
    const CollisionShape& b = collision_.shapes()[std::size_t(p.shape_b)];
    const Material material = combine(a.material, b.material);
    const int row = dynamics_.addRow(a.link, b.link, p.point, p.normal);
    compliant_.push_back({ row, p.distance, material.stiffness, p.share, material.damping_ratio, material.friction });
    if (material.friction <= 0.0)
      continue;
    const Eigen::Vector3d tangent = p.normal.unitOrthogonal();
    dynamics_.addRow(a.link, b.link, p.point, tangent);
    dynamics_.addRow(a.link, b.link, p.point, p.normal.cross(tangent));
  }
}

void World::addStops(double dt) noexcept
{
  for (int joint = 0; joint < dynamics_.dofs(); ++joint)
  {
    const JointDescription& limits = model().joints()[std::size_t(joint)].description;
    const double near = std::max(kNearStop, 2.0 * dt * std::abs(qd()(joint)));
    const double above = q()(joint) - limits.lower, below = limits.upper - q()(joint);
    if (above < near)
      compliant_.push_back(
          { dynamics_.addJointRow(joint, 1.0), above, stop_stiffness_, 1.0, stop_damping_ratio_, 0.0 });
    if (below < near)
      compliant_.push_back(
          { dynamics_.addJointRow(joint, -1.0), below, stop_stiffness_, 1.0, stop_damping_ratio_, 0.0 });
  }
}

void World::readContacts(double dt) noexcept
{
  contacts_.clear();
  for (std::size_t i = 0; i < found_.size(); ++i)
  {
    const Proximity& p = found_[i];
    const CompliantContact& row = compliant_[i];
    Contact contact;
    contact.point = p.point;
    contact.normal = p.normal;
    contact.depth = -p.distance;
    contact.force = impulses_(row.row) / dt * p.normal;
    if (row.friction > 0.0)
    {
      const Eigen::Vector3d tangent = p.normal.unitOrthogonal();
      contact.force += (impulses_(row.row + 1) * tangent + impulses_(row.row + 2) * p.normal.cross(tangent)) / dt;
    }
    contact.link_a = collision_.shapes()[std::size_t(p.shape_a)].link;
    contact.link_b = collision_.shapes()[std::size_t(p.shape_b)].link;
    contact.static_a = p.shape_a < moving_shapes_ ? -1 : p.shape_a - moving_shapes_;
    contact.static_b = p.shape_b < moving_shapes_ ? -1 : p.shape_b - moving_shapes_;
    contacts_.push_back(contact);
  }
}

Eigen::Vector3d World::contactForce(int link) const noexcept
{
  Eigen::Vector3d sum = Eigen::Vector3d::Zero();
  for (const Contact& contact : contacts_)
  {
    if (contact.link_a == link)
      sum += contact.force;
    if (contact.link_b == link)
      sum -= contact.force;
  }
  return sum;
}

double World::energy() noexcept
{
  double sum = dynamics_.kineticEnergy() + dynamics_.potentialEnergy();
  locate();
  collision_.detect(found_);
  for (const Proximity& p : found_)
  {
    const Material material = combine(collision_.shapes()[std::size_t(p.shape_a)].material,
                                      collision_.shapes()[std::size_t(p.shape_b)].material);
    sum += 0.5 * p.share * material.stiffness * std::pow(std::min(p.distance, 0.0), 2);
  }
  for (int joint = 0; joint < dynamics_.dofs(); ++joint)
  {
    const JointDescription& limits = model().joints()[std::size_t(joint)].description;
    const double beyond = std::max({ limits.lower - q()(joint), q()(joint) - limits.upper, 0.0 });
    sum += 0.5 * stop_stiffness_ * beyond * beyond;
  }
  for (int joint = 0; joint < dynamics_.dofs(); ++joint)
  {
    const JointDrive& drive = dynamics_.drives()[std::size_t(joint)];
    sum += 0.5 * drive.stiffness * std::pow(drive.position - q()(joint), 2);
  }
  return sum;
}
}  // namespace phri_sim
