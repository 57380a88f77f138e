#include "phri_sim/tree_model.hpp"

#include <cmath>
#include <set>
#include <sstream>
#include <utility>

namespace phri_sim
{
namespace
{
constexpr double kUnit = 1e-6;              // deviation of axes and rotations from unit length that is only rounding
constexpr double kSmallestInertia = 1e-12;  // [kgm2, kg] of what a joint moves: below, the mass matrix is singular

template <typename... Parts>
std::string text(const Parts&... parts)
{
  std::ostringstream stream;
  (stream << ... << parts);
  return stream.str();
}

template <typename Items, typename NameOf>
int indexOf(const Items& items, const std::string& name, const char* kind, NameOf nameOf)
{
  for (std::size_t i = 0; i < items.size(); ++i)
  {
    if (nameOf(items[i]) == name)
      return int(i);
  }
  std::string message = text("no ", kind, " '", name, "' in the tree; known:");
  for (const auto& item : items)
    message += " " + nameOf(item);
  throw std::out_of_range(message);
}

/// Rotation whose third column is `axis`: exact for the axes of coordinates.
Eigen::Matrix3d frameOfAxis(const Eigen::Vector3d& axis)
{
  const Eigen::Vector3d z = axis.normalized();
  int across = 0;
  z.cwiseAbs().minCoeff(&across);
  Eigen::Matrix3d frame;
  frame.col(2) = z;
  frame.col(0) = z.isApprox(Eigen::Vector3d::UnitZ(), 0.0) ? Eigen::Vector3d::UnitX().eval()
                                                           : Eigen::Vector3d::Unit(across).cross(z).normalized().eval();
  frame.col(1) = frame.col(2).cross(frame.col(0));
  return frame;
}

LumpInertia inBody(const LinkDescription& link, const Eigen::Isometry3d& pose)
{
  const Eigen::Vector3d centre = pose * link.centre;
  LumpInertia lump;
  lump.mass = link.mass;
  lump.moment = link.mass * centre;
  lump.inertia = pose.linear() * link.inertia * pose.linear().transpose() +
                 link.mass * (centre.squaredNorm() * Eigen::Matrix3d::Identity() - centre * centre.transpose());
  return lump;
}

bool isPose(const Eigen::Isometry3d& pose)
{
  return pose.matrix().allFinite() && pose.linear().isUnitary(kUnit) && pose.linear().determinant() > 0.0;
}

void checkLink(const LinkDescription& link, std::vector<std::string>& errors)
{
  if (!(link.mass >= 0.0) || !std::isfinite(link.mass) || !link.centre.allFinite() || !link.inertia.allFinite())
    errors.push_back(text("link '", link.name, "': mass ", link.mass,
                          " kg, centre and inertia must be finite and the mass not negative"));
}

void checkJoint(const JointDescription& joint, std::vector<std::string>& errors)
{
  if (!isPose(joint.origin))
    errors.push_back(text("joint '", joint.name, "': origin must be finite, with a rotation"));
  if (joint.kind == JointKind::Fixed)
    return;
  if (!(std::abs(joint.axis.norm() - 1.0) < kUnit))
    errors.push_back(text("joint '", joint.name, "': axis of length ", joint.axis.norm(), ", must be 1"));
  if (!(joint.damping >= 0.0) || !std::isfinite(joint.damping))
    errors.push_back(text("joint '", joint.name, "': damping ", joint.damping, ", must be finite and not negative"));
  if (!(joint.friction >= 0.0) || !std::isfinite(joint.friction))
    errors.push_back(text("joint '", joint.name, "': friction ", joint.friction, ", must be finite and not negative"));
}

void checkOptions(const TreeOptions& options, const std::set<std::string>& moving, std::vector<std::string>& errors)
{
  if (!options.gravity.allFinite())
    errors.push_back("gravity must be finite");
  if (!(options.friction_speed > 0.0) || !std::isfinite(options.friction_speed))
    errors.push_back(text("friction_speed ", options.friction_speed, ", must be finite and positive"));
  for (const auto& [name, armature] : options.armature)
  {
    if (moving.count(name) == 0)
      errors.push_back(text("armature of '", name, "': no moving joint of that name"));
    if (!(armature >= 0.0) || !std::isfinite(armature))
      errors.push_back(text("armature of '", name, "': ", armature, ", must be finite and not negative"));
  }
}

/// What each joint has to move, all joints at position 0.
void checkInertias(const std::vector<TreeBody>& bodies, const std::vector<TreeJoint>& joints,
                   std::vector<std::string>& errors)
{
  std::vector<LumpInertia> carried;
  for (const TreeBody& body : bodies)
    carried.push_back(body.inertia);
  for (std::size_t i = bodies.size(); i-- > 0;)
  {
    const double inertia = bodies[i].revolute ? carried[i].inertia(2, 2) : carried[i].mass;
    if (!(inertia + joints[i].armature > kSmallestInertia))
      errors.push_back(text("joint '", joints[i].description.name, "': moves an inertia of ", inertia,
                            " without armature, must be above ", kSmallestInertia));
    if (bodies[i].parent < 0)
      continue;
    LinkDescription lump;  // the same, seen as a link of the parent
    lump.mass = carried[i].mass;
    lump.centre = lump.mass > 0.0 ? (carried[i].moment / lump.mass).eval() : Eigen::Vector3d::Zero().eval();
    lump.inertia = carried[i].inertia - lump.mass * (lump.centre.squaredNorm() * Eigen::Matrix3d::Identity() -
                                                     lump.centre * lump.centre.transpose());
    Eigen::Isometry3d pose = Eigen::Isometry3d::Identity();
    pose.linear() = bodies[i].rotation;
    pose.translation() = bodies[i].origin;
    carried[std::size_t(bodies[i].parent)] += inBody(lump, pose);
  }
}
/// Collects the members of a TreeModel part by part.
class Builder
{
public:
  explicit Builder(const TreeOptions& options) : options_(options) {}

  void addPart(const TreePart& part)
  {
    const RobotDescription& description = part.description;
    if (description.links.empty() || description.joints.size() + 1 != description.links.size())
    {
      errors.push_back(text("part '", description.name, "': ", description.links.size(), " links, ",
                            description.joints.size(), " joints; every link but the root needs one joint"));
      return;
    }
    if (!isPose(part.pose))
      errors.push_back(text("part '", description.name, "': pose must be finite, with a rotation"));
    TreeLink holder;  // the world
    int parent = -1;
    if (!part.parent.empty())
    {
      const auto found = link_of_.find(part.parent);
      if (found == link_of_.end())
      {
        errors.push_back(text("part '", description.name, "': no link '", part.parent, "' in the parts before it"));
        return;
      }
      parent = found->second;
      holder = links[std::size_t(parent)];
    }
    addFixedJoint(description.links[0].name + "_mount");
    addLink(description.links[0], parent, holder.body, holder.pose * part.pose, true);
    for (std::size_t j = 0; j < description.joints.size(); ++j)
      addJoint(description.joints[j], description.links[j + 1]);
  }

  void finish()
  {
    checkOptions(options_, moving_, errors);
    if (errors.empty())
      checkInertias(bodies, joints, errors);
    if (!errors.empty())
      throw DescriptionError("kinematic tree", errors);
    for (TreeFixedJoint& fixed : fixed_joints)
      findBeyond(fixed);
  }

  std::vector<TreeBody> bodies;
  std::vector<TreeJoint> joints;
  std::vector<TreeLink> links;
  std::vector<TreeFixedJoint> fixed_joints;
  std::vector<std::string> errors;

private:
  void addJointName(const std::string& name)
  {
    if (!joint_names_.insert(name).second)
      errors.push_back(text("joint '", name, "': name used twice"));
  }

  /// Of the link that is added next.
  void addFixedJoint(const std::string& name)
  {
    addJointName(name);
    TreeFixedJoint fixed;
    fixed.name = name;
    fixed.link = int(links.size());
    fixed_joints.push_back(fixed);
  }

  void addLink(const LinkDescription& link, int parent, int body, const Eigen::Isometry3d& pose, bool fixed)
  {
    checkLink(link, errors);
    if (!link_of_.emplace(link.name, int(links.size())).second)
      errors.push_back(text("link '", link.name, "': name used twice"));
    links.push_back({ link.name, body, pose, link.collision });
    parent_.push_back(parent);
    is_fixed_.push_back(fixed);
    lumps_.push_back(inBody(link, pose));
    if (body >= 0)
      bodies[std::size_t(body)].inertia += lumps_.back();
  }

  void addJoint(const JointDescription& joint, const LinkDescription& child)
  {
    checkJoint(joint, errors);
    const auto found = link_of_.find(joint.parent);
    if (found == link_of_.end() || joint.child != child.name)
    {
      errors.push_back(text("joint '", joint.name, "': parent '", joint.parent, "' must be a link before it, child '",
                            joint.child, "' must be link '", child.name, "'"));
      return;
    }
    const TreeLink& parent = links[std::size_t(found->second)];
    const Eigen::Isometry3d frame = parent.pose * joint.origin;
    if (joint.kind == JointKind::Fixed)
    {
      addFixedJoint(joint.name);
      addLink(child, found->second, parent.body, frame, true);
      return;
    }
    addJointName(joint.name);
    moving_.insert(joint.name);
    const Eigen::Matrix3d to_axis = frameOfAxis(joint.axis);
    TreeBody body;
    body.parent = parent.body;
    body.revolute = joint.kind == JointKind::Revolute;
    body.rotation = frame.linear() * to_axis;
    body.origin = frame.translation();
    bodies.push_back(body);
    const auto armature = options_.armature.find(joint.name);
    joints.push_back({ joint, armature == options_.armature.end() ? joint.armature : armature->second });
    Eigen::Isometry3d in_body = Eigen::Isometry3d::Identity();
    in_body.linear() = to_axis.transpose();
    addLink(child, found->second, int(bodies.size()) - 1, in_body, false);
  }

  void findBeyond(TreeFixedJoint& fixed) const
  {
    fixed.links_beyond.assign(links.size(), 0);
    const int own = links[std::size_t(fixed.link)].body;
    for (std::size_t l = std::size_t(fixed.link); l < links.size(); ++l)
    {
      if (int(l) != fixed.link && (parent_[l] < 0 || !fixed.links_beyond[std::size_t(parent_[l])]))
        continue;
      fixed.links_beyond[l] = 1;
      if (links[l].body == own)
        fixed.beyond += lumps_[l];
      else if (!is_fixed_[l])  // the first link of a body: all others hang on it
        fixed.bodies_beyond.push_back(links[l].body);
    }
  }

  const TreeOptions& options_;
  std::map<std::string, int> link_of_;
  std::set<std::string> joint_names_, moving_;
  std::vector<int> parent_;         // per link: the link before it, -1: the world
  std::vector<bool> is_fixed_;      // per link: by a fixed joint
  std::vector<LumpInertia> lumps_;  // per link, in its body
};
}  // namespace

LumpInertia& LumpInertia::operator+=(const LumpInertia& other)
{
  mass += other.mass;
  moment += other.moment;
  inertia += other.inertia;
  return *this;
}

TreeModel::TreeModel(const std::vector<TreePart>& parts, const TreeOptions& options) : options_(options)
{
  Builder builder(options_);
  for (const TreePart& part : parts)
    builder.addPart(part);
  builder.finish();
  bodies_ = std::move(builder.bodies);
  joints_ = std::move(builder.joints);
  links_ = std::move(builder.links);
  fixed_joints_ = std::move(builder.fixed_joints);
}

int TreeModel::link(const std::string& name) const
{
  return indexOf(links_, name, "link", [](const TreeLink& link) { return link.name; });
}

int TreeModel::joint(const std::string& name) const
{
  return indexOf(joints_, name, "moving joint", [](const TreeJoint& joint) { return joint.description.name; });
}

int TreeModel::fixedJoint(const std::string& name) const
{
  return indexOf(fixed_joints_, name, "fixed joint", [](const TreeFixedJoint& joint) { return joint.name; });
}
}  // namespace phri_sim
