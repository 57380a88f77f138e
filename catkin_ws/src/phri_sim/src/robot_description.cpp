#include "phri_sim/robot_description.hpp"

#include <Eigen/Eigenvalues>
#include <algorithm>
#include <cmath>
#include <filesystem>
#include <fstream>
#include <map>
#include <sstream>

#include "phri_core/check.hpp"
#include "phri_sim/configuration.hpp"
#include "urdf_reader.hpp"

namespace phri_sim
{
namespace
{
namespace fs = std::filesystem;
constexpr double kRounding = 0.01;     // of published moments of inertia, relative
constexpr double kRoughShape = 1.25;   // bodies reach further than their collision shapes, at most by this factor
constexpr double kSingular = 1e-9;     // smallest eigenvalue of the mass matrix, scaled to a diagonal of ones
constexpr std::size_t kLargest = 4e6;  // bytes of a file

template <typename... Parts>
std::string text(const Parts&... parts)
{
  std::ostringstream out;
  (out << ... << parts);
  return out.str();
}

std::string joined(const std::vector<std::string>& names)
{
  std::string all;
  for (const std::string& name : names)
    all += (all.empty() ? "" : ", ") + name;
  return all;
}

std::string lines(const std::string& where, const std::vector<std::string>& errors)
{
  std::string all = where + ": " + std::to_string(errors.size()) + (errors.size() == 1 ? " error" : " errors");
  for (const std::string& error : errors)
    all += "\n  " + error;
  return all;
}

template <typename Item>
int find(const std::vector<Item>& items, const std::string& name, const char* kind, const std::string& robot)
{
  std::string known;
  for (std::size_t i = 0; i < items.size(); ++i)
  {
    if (items[i].name == name)
      return int(i);
    known += (i ? ", " : "") + items[i].name;
  }
  throw std::out_of_range(text("robot ", robot, " has no ", kind, " \"", name, "\"; it has: ", known));
}

template <typename Item>
void checkNames(const std::vector<Item>& items, const char* kind, std::vector<std::string>& errors)
{
  std::map<std::string, int> count;
  for (const Item& item : items)
    if (++count[item.name] == 2 && !item.name.empty())
      errors.push_back(text(kind, ' ', item.name, ": the name is used twice"));
}

/// Index of the joint that carries each link; -1: none.
std::map<std::string, int> carriers(const RobotDescription& robot, std::vector<std::string>& errors)
{
  std::map<std::string, int> by_link;
  std::vector<std::string> names;
  for (const LinkDescription& link : robot.links)
  {
    by_link[link.name] = -1;
    names.push_back(link.name);
  }
  for (std::size_t j = 0; j < robot.joints.size(); ++j)
  {
    const JointDescription& joint = robot.joints[j];
    for (const std::string& end : { joint.parent, joint.child })
      if (!end.empty() && !by_link.count(end))
      {
        const std::string near = phri_core::closest(end, names);
        errors.push_back(
            text("joint ", joint.name, ": no link ", end, near.empty() ? "" : ": did you mean " + near + "?"));
      }
    const auto carrier = by_link.find(joint.child);
    if (carrier == by_link.end())
      continue;
    if (carrier->second >= 0)
      errors.push_back(text("link ", joint.child, ": child of joints ", robot.joints[std::size_t(carrier->second)].name,
                            " and ", joint.name, ": expected one"));
    carrier->second = int(j);
  }
  return by_link;
}

/// Sorts links and joints from the root on, branch by branch; false if they are not one tree.
bool makeTree(RobotDescription& robot, std::vector<std::string>& errors)
{
  const std::size_t before = errors.size();
  checkNames(robot.links, "link", errors);
  checkNames(robot.joints, "joint", errors);
  const std::map<std::string, int> by_link = carriers(robot, errors);
  std::map<std::string, LinkDescription> left;
  std::vector<std::string> roots;
  for (const LinkDescription& link : robot.links)
  {
    left[link.name] = link;
    if (by_link.at(link.name) < 0)
      roots.push_back(link.name);
  }
  if (robot.links.empty())
    errors.push_back("no link: expected at least one");
  else if (roots.empty())
    errors.push_back("no root: every link is some joint's child, so there is a loop");
  else if (roots.size() > 1)
    errors.push_back(text(roots.size(), " roots: ", joined(roots), ": expected one"));
  const bool ends = std::all_of(robot.joints.begin(), robot.joints.end(), [](const JointDescription& joint) {
    return !joint.parent.empty() && !joint.child.empty();
  });
  if (errors.size() > before || !ends)
    return false;

  std::multimap<std::string, const JointDescription*> below;  // by parent, in the order of the file
  for (const JointDescription& joint : robot.joints)
    below.emplace(joint.parent, &joint);
  RobotDescription sorted;
  std::vector<const JointDescription*> stack;
  const auto take = [&](const std::string& link) {
    sorted.links.push_back(left.at(link));
    left.erase(link);
    const auto [first, last] = below.equal_range(link);
    for (auto it = last; it != first;)
      stack.push_back((--it)->second);
  };
  take(roots.front());
  while (!stack.empty())
  {
    const JointDescription* joint = stack.back();
    stack.pop_back();
    sorted.joints.push_back(*joint);
    take(joint->child);
  }
  std::vector<std::string> lost;
  for (const auto& [name, link] : left)
    lost.push_back(name);
  if (!lost.empty())
    errors.push_back(text("loop: links ", joined(lost), " are not reached from the root ", roots.front()));
  robot.links = std::move(sorted.links);
  robot.joints = std::move(sorted.joints);
  return lost.empty();
}

/// Farthest that the link's collision shapes get from its centre of mass; 0 without shapes.
double reach(const LinkDescription& link)
{
  double farthest = 0.0;
  for (const ShapeDescription& shape : link.collision)
  {
    const Eigen::Vector3d centre = shape.origin.inverse() * link.centre;
    double distance = centre.norm() + shape.size.x();  // sphere
    if (shape.kind == ShapeKind::Box)
      distance = (centre.cwiseAbs() + shape.size / 2).norm();
    else if (shape.kind == ShapeKind::Cylinder)
      distance = std::hypot(centre.head<2>().norm() + shape.size.x(), std::abs(centre.z()) + shape.size.y() / 2);
    farthest = std::max(farthest, distance);
  }
  return farthest;
}

void checkInertia(const LinkDescription& link, std::vector<std::string>& errors)
{
  if (!(link.mass > 0.0) || !link.inertia.allFinite())
    return;
  const Eigen::Vector3d moments = Eigen::SelfAdjointEigenSolver<Eigen::Matrix3d>(link.inertia).eigenvalues();
  const std::string which = text("link ", link.name, ": inertia with principal moments ", moments[0], ", ", moments[1],
                                 ", ", moments[2], " kgm2 ");
  if (!(moments[0] > 0.0))
    errors.push_back(which + "is not positive definite: expected all above 0");
  else if (moments[0] + moments[1] < moments[2] * (1.0 - kRounding))
    errors.push_back(which + "belongs to no body: expected the largest at most the sum of the others");
  const double gyration = std::sqrt(std::max(moments[2], 0.0) / link.mass), farthest = kRoughShape * reach(link);
  if (farthest > 0.0 && gyration > farthest)
    errors.push_back(text(which, "and mass ", link.mass, " kg has a radius of gyration of ", gyration,
                          " m: expected at most ", farthest, ", ", kRoughShape, " times as far as its shapes reach"));
}

/// Sum of the masses that move with each joint's child.
std::vector<double> carriedMass(const RobotDescription& robot, const std::vector<int>& parents)
{
  std::vector<double> mass;
  for (const LinkDescription& link : robot.links)
    mass.push_back(link.mass);
  for (std::size_t i = robot.joints.size(); i-- > 0;)
    mass[std::size_t(parents[i])] += mass[i + 1];
  return { mass.begin() + 1, mass.end() };
}

/// Joints that could be accelerated without force, at position 0: two without mass between them that move alike.
void checkMassMatrix(const RobotDescription& robot, const std::vector<int>& parents, std::vector<std::string>& errors)
{
  const std::size_t count = robot.joints.size();
  if (count == 0)
    return;
  std::vector<Eigen::Isometry3d> poses(count + 1, Eigen::Isometry3d::Identity());
  Eigen::MatrixXd mass = Eigen::MatrixXd::Zero(Eigen::Index(count), Eigen::Index(count));
  for (std::size_t i = 0; i < count; ++i)
    poses[i + 1] = poses[std::size_t(parents[i])] * robot.joints[i].origin;
  for (std::size_t l = 1; l <= count; ++l)
  {
    const LinkDescription& link = robot.links[l];
    const Eigen::Vector3d centre = poses[l] * link.centre;
    Eigen::MatrixXd linear = Eigen::MatrixXd::Zero(3, Eigen::Index(count)), angular = linear;
    for (std::size_t i = l; i > 0; i = std::size_t(parents[i - 1]))
    {
      const JointDescription& joint = robot.joints[i - 1];
      const Eigen::Vector3d axis = poses[i].linear() * joint.axis;
      if (joint.kind == JointKind::Prismatic)
        linear.col(Eigen::Index(i) - 1) = axis;
      else if (joint.kind == JointKind::Revolute)
      {
        linear.col(Eigen::Index(i) - 1) = axis.cross(centre - poses[i].translation());
        angular.col(Eigen::Index(i) - 1) = axis;
      }
    }
    const Eigen::Matrix3d inertia = poses[l].linear() * link.inertia * poses[l].linear().transpose();
    mass += link.mass * linear.transpose() * linear + angular.transpose() * inertia * angular;
  }
  for (std::size_t i = 0; i < count; ++i)
    mass(Eigen::Index(i), Eigen::Index(i)) += robot.joints[i].kind == JointKind::Fixed ? 1.0 : robot.joints[i].armature;
  const Eigen::VectorXd scale = mass.diagonal().cwiseSqrt().cwiseInverse();
  const Eigen::SelfAdjointEigenSolver<Eigen::MatrixXd> solver(scale.asDiagonal() * mass * scale.asDiagonal());
  if (solver.eigenvalues()[0] > kSingular)
    return;
  std::vector<std::string> names;
  for (std::size_t i = 0; i < count; ++i)
    if (std::abs(solver.eigenvectors()(Eigen::Index(i), 0)) > 0.1)
      names.push_back(robot.joints[i].name);
  errors.push_back("joints " + joined(names) +
                   " can move together without moving any mass: expected mass between them");
}

void checkMoving(const RobotDescription& robot, std::vector<std::string>& errors)
{
  std::vector<int> parents;
  for (const JointDescription& joint : robot.joints)
    parents.push_back(robot.link(joint.parent));
  const std::vector<double> carried = carriedMass(robot, parents);
  for (std::size_t i = 0; i < robot.joints.size(); ++i)
    if (robot.joints[i].kind != JointKind::Fixed && carried[i] == 0.0)
      errors.push_back(text("joint ", robot.joints[i].name, ": link ", robot.joints[i].child,
                            " and what it carries have mass 0 kg: expected above 0 on what moves"));
  if (errors.empty())
    checkMassMatrix(robot, parents, errors);
}
}  // namespace

int RobotDescription::link(const std::string& wanted) const
{
  return find(links, wanted, "link", name);
}
int RobotDescription::joint(const std::string& wanted) const
{
  return find(joints, wanted, "joint", name);
}

DescriptionError::DescriptionError(const std::string& where, std::vector<std::string> errors)
  : std::invalid_argument(lines(where, errors)), errors_(std::move(errors))
{
}

RobotDescription parseRobot(const std::string& urdf, const std::string& where)
{
  std::vector<std::string> errors;
  RobotDescription robot;
  const bool document_read = readUrdf(urdf, robot, errors);
  for (const LinkDescription& link : robot.links)
    checkInertia(link, errors);
  if (document_read && makeTree(robot, errors))
    checkMoving(robot, errors);
  if (!errors.empty())
    throw DescriptionError(where, std::move(errors));
  return robot;
}

RobotDescription loadRobot(const std::string& name_or_path)
{
  const fs::path folder = fs::path(shareFolder()) / "urdf";
  const fs::path path = fs::is_regular_file(name_or_path) ? fs::path(name_or_path) : folder / (name_or_path + ".urdf");
  if (!fs::is_regular_file(path))
  {
    std::vector<std::string> known;
    if (fs::is_directory(folder))
      for (const auto& entry : fs::directory_iterator(folder))
        if (entry.path().extension() == ".urdf")
          known.push_back(entry.path().stem().string());
    std::sort(known.begin(), known.end());
    const std::string near = phri_core::closest(name_or_path, known);
    throw DescriptionError("robot \"" + name_or_path + '"',
                           { text("no such file, and no ", path.string(), "; known: ", joined(known),
                                  near.empty() ? "" : "; did you mean " + near + "?") });
  }
  if (fs::file_size(path) > kLargest)
    throw DescriptionError(path.string(), { text("has ", fs::file_size(path), " bytes: expected at most ", kLargest) });
  std::ifstream file(path);
  std::stringstream content;
  content << file.rdbuf();
  if (!file)
    throw DescriptionError(path.string(), { "cannot be read" });
  return parseRobot(content.str(), path.string());
}
}  // namespace phri_sim
