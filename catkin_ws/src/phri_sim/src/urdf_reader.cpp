#include "urdf_reader.hpp"

#include <tinyxml2.h>

#include <charconv>
#include <cmath>
#include <optional>
#include <sstream>

#include "phri_core/check.hpp"

namespace phri_sim
{
namespace
{
using tinyxml2::XMLElement;
constexpr double kUnit = 1e-3;  // an axis may be this far from length 1: rounded digits
constexpr double kMissing = std::numeric_limits<double>::quiet_NaN();  // reported, and passes every later comparison

const std::vector<std::string> kLinkWords{ "inertial", "visual", "collision" };
const std::vector<std::string> kJointWords{ "origin",     "parent", "child", "axis",
                                            "dynamics",   "limit",  "mimic", "safety_controller",
                                            "calibration" };

class Reader
{
public:
  explicit Reader(std::vector<std::string>& errors) : errors_(errors) {}

  void read(const XMLElement& root, RobotDescription& robot)
  {
    robot.name = name(root, "robot");
    for (const XMLElement* e = root.FirstChildElement(); e; e = e->NextSiblingElement())
    {
      const std::string word = e->Name();
      if (word == "link")
        robot.links.push_back(readLink(*e));
      else if (word == "joint")
        robot.joints.push_back(readJoint(*e));
    }
  }

private:
  template <typename... Parts>
  void error(const XMLElement* element, const Parts&... parts)
  {
    std::ostringstream out;
    if (element)
      out << "line " << element->GetLineNum() << ": ";
    (out << ... << parts);
    errors_.push_back(out.str());
  }

  std::string name(const XMLElement& element, const char* kind)
  {
    const char* text = element.Attribute("name");
    if (!text || !*text)
      error(&element, kind, " without a name");
    return text ? text : "";
  }

  /// The numbers of an attribute, or nothing if there is no such attribute.
  std::optional<std::vector<double>> list(const XMLElement& element, const char* key, std::size_t count)
  {
    const char* text = element.Attribute(key);
    if (!text)
      return std::nullopt;
    std::vector<double> values;
    std::istringstream words(text);
    for (std::string word; words >> word;)
    {
      double value = kMissing;
      const char *begin = word.data() + (word[0] == '+'), *end = word.data() + word.size();
      const auto [stop, status] = std::from_chars(begin, end, value);
      if (status != std::errc() || stop != end || !std::isfinite(value))
      {
        error(&element, owner_, ": ", element.Name(), ' ', key, " \"", text, "\": expected ", count,
              count == 1 ? " finite number" : " finite numbers");
        return std::vector<double>(count, kMissing);
      }
      values.push_back(value);
    }
    if (values.size() == count)
      return values;
    error(&element, owner_, ": ", element.Name(), ' ', key, " \"", text, "\": expected ", count,
          count == 1 ? " number" : " numbers");
    return std::vector<double>(count, kMissing);
  }

  double optional(const XMLElement& element, const char* key, double otherwise)
  {
    const auto values = list(element, key, 1);
    return values ? values->front() : otherwise;
  }

  double required(const XMLElement& element, const char* key)
  {
    if (!element.Attribute(key))
      error(&element, owner_, ": ", element.Name(), " has no ", key, ": expected a number");
    return optional(element, key, kMissing);
  }

  Eigen::Vector3d vector(const XMLElement& element, const char* key, const Eigen::Vector3d& otherwise)
  {
    const auto values = list(element, key, 3);
    return values ? Eigen::Vector3d(values->data()) : otherwise;
  }

  /// The only child of that name, or null.
  const XMLElement* only(const XMLElement& element, const char* word)
  {
    const XMLElement* first = element.FirstChildElement(word);
    if (first && first->NextSiblingElement(word))
      error(first->NextSiblingElement(word), owner_, ": a second ", word, " in its ", element.Name(), ": expected one");
    return first;
  }

  Eigen::Isometry3d origin(const XMLElement& element)
  {
    Eigen::Isometry3d pose = Eigen::Isometry3d::Identity();
    if (const XMLElement* e = only(element, "origin"))
    {
      const Eigen::Vector3d rpy = vector(*e, "rpy", Eigen::Vector3d::Zero());
      pose.translation() = vector(*e, "xyz", Eigen::Vector3d::Zero());
      pose.linear() =
          (Eigen::AngleAxisd(rpy.z(), Eigen::Vector3d::UnitZ()) * Eigen::AngleAxisd(rpy.y(), Eigen::Vector3d::UnitY()) *
           Eigen::AngleAxisd(rpy.x(), Eigen::Vector3d::UnitX()))
              .toRotationMatrix();
    }
    return pose;
  }

  /// Elements that nobody knows may be somebody's extension, unless they look like a slip of the pen.
  void checkWords(const XMLElement& element, const std::vector<std::string>& known)
  {
    for (const XMLElement* e = element.FirstChildElement(); e; e = e->NextSiblingElement())
    {
      const std::string near = phri_core::closest(e->Name(), known);
      if (!near.empty() && near != e->Name())
        error(e, owner_, ": element ", e->Name(), " is not known: did you mean ", near, "?");
    }
  }

  LinkDescription readLink(const XMLElement& element)
  {
    LinkDescription link;
    link.name = name(element, "link");
    owner_ = "link " + link.name;
    checkWords(element, kLinkWords);
    if (const XMLElement* inertial = only(element, "inertial"))
      readInertial(*inertial, link);
    for (const XMLElement* e = element.FirstChildElement("collision"); e; e = e->NextSiblingElement("collision"))
      link.collision.push_back(readShape(*e));
    return link;
  }

  void readInertial(const XMLElement& element, LinkDescription& link)
  {
    const Eigen::Isometry3d pose = origin(element);
    link.centre = pose.translation();
    const XMLElement *mass = only(element, "mass"), *inertia = only(element, "inertia");
    link.mass = mass ? required(*mass, "value") : kMissing;
    if (!mass)
      error(&element, owner_, ": its inertial has no mass");
    else if (link.mass < 0.0)
      error(mass, owner_, ": mass ", link.mass, " kg: expected above 0");
    if (!inertia)
    {
      error(&element, owner_, ": its inertial has no inertia");
      link.inertia.setConstant(kMissing);
      return;
    }
    const double xy = required(*inertia, "ixy"), xz = required(*inertia, "ixz"), yz = required(*inertia, "iyz");
    link.inertia << required(*inertia, "ixx"), xy, xz,  //
        xy, required(*inertia, "iyy"), yz,              //
        xz, yz, required(*inertia, "izz");
    if (link.mass == 0.0 && !link.inertia.isZero(0.0))
      error(inertia, owner_, ": mass 0 kg with an inertia: expected a mass above 0, or no inertial");
    link.inertia = pose.linear() * link.inertia * pose.linear().transpose();
  }

  ShapeDescription readShape(const XMLElement& element)
  {
    ShapeDescription shape;
    shape.origin = origin(element);
    const XMLElement* geometry = only(element, "geometry");
    const XMLElement* e = geometry ? geometry->FirstChildElement() : nullptr;
    const std::string kind = e ? e->Name() : "nothing";
    int sizes = 0;
    if (kind == "box")
    {
      sizes = 3;
      if (!e->Attribute("size"))
        error(e, owner_, ": collision box has no size: expected three edges [m]");
      shape.size = vector(*e, "size", Eigen::Vector3d::Constant(kMissing));
    }
    else if (kind == "cylinder" || kind == "sphere")
    {
      shape.kind = kind == "sphere" ? ShapeKind::Sphere : ShapeKind::Cylinder;
      sizes = kind == "sphere" ? 1 : 2;
      shape.size.x() = required(*e, "radius");
      shape.size.y() = sizes == 2 ? required(*e, "length") : 0.0;
    }
    else
      error(&element, owner_, ": collision geometry ", kind, ": expected a box, a cylinder or a sphere");
    if ((shape.size.head(sizes).array() <= 0.0).any())
      error(e, owner_, ": collision ", kind, " of size ", shape.size.head(sizes).transpose(), " m: expected above 0");
    if (e && e->NextSiblingElement())
      error(e->NextSiblingElement(), owner_, ": a second shape in its geometry: expected one per collision");
    return shape;
  }

  std::string linkOf(const XMLElement& element, const char* word)
  {
    const XMLElement* e = only(element, word);
    const char* text = e ? e->Attribute("link") : nullptr;
    if (!text)
      error(&element, owner_, ": no ", word, " link");
    return text ? text : "";
  }

  JointDescription readJoint(const XMLElement& element)
  {
    JointDescription joint;
    joint.name = name(element, "joint");
    owner_ = "joint " + joint.name;
    checkWords(element, kJointWords);
    joint.parent = linkOf(element, "parent");
    joint.child = linkOf(element, "child");
    joint.origin = origin(element);
    const std::string type = element.Attribute("type") ? element.Attribute("type") : "";
    if (type == "revolute" || type == "continuous")
      joint.kind = JointKind::Revolute;
    else if (type == "prismatic")
      joint.kind = JointKind::Prismatic;
    else if (type != "fixed")
      error(&element, owner_, ": type \"", type, "\": expected revolute, continuous, prismatic or fixed");
    if (joint.kind == JointKind::Fixed)
      return joint;
    if (const XMLElement* mimic = only(element, "mimic"))
      error(mimic, owner_, ": mimic: not supported, expected a joint of its own");
    readMotion(element, type == "continuous", joint);
    return joint;
  }

  void readMotion(const XMLElement& element, bool continuous, JointDescription& joint)
  {
    const XMLElement* axis = only(element, "axis");
    joint.axis = axis ? vector(*axis, "xyz", Eigen::Vector3d::UnitX()) : Eigen::Vector3d::UnitX();  // as URDF has it
    if (const double length = joint.axis.norm(); std::abs(length - 1.0) > kUnit)
      error(axis, owner_, ": axis of length ", length, ": expected 1");
    joint.axis.normalize();

    const XMLElement* limit = only(element, "limit");
    if (!limit && !continuous)
      error(&element, owner_, ": no limit: expected lower, upper, velocity and effort");
    if (limit && !continuous)
    {
      joint.lower = required(*limit, "lower");
      joint.upper = required(*limit, "upper");
      if (joint.lower >= joint.upper)
        error(limit, owner_, ": limits from ", joint.lower, " to ", joint.upper, ": expected lower below upper");
    }
    if (limit)
    {
      joint.velocity = required(*limit, "velocity");
      joint.effort = required(*limit, "effort");
      if (joint.velocity <= 0.0 || joint.effort <= 0.0)
        error(limit, owner_, ": largest velocity ", joint.velocity, " and effort ", joint.effort, ": expected above 0");
    }
    if (const XMLElement* dynamics = only(element, "dynamics"))
    {
      joint.damping = optional(*dynamics, "damping", 0.0);
      joint.friction = optional(*dynamics, "friction", 0.0);
      joint.armature = optional(*dynamics, "armature", 0.0);
      if (joint.damping < 0.0 || joint.friction < 0.0 || joint.armature < 0.0)
        error(dynamics, owner_, ": damping ", joint.damping, ", friction ", joint.friction, ", armature ",
              joint.armature, ": expected 0 or more");
    }
  }

  std::vector<std::string>& errors_;
  std::string owner_;
};
}  // namespace

bool readUrdf(const std::string& urdf, RobotDescription& robot, std::vector<std::string>& errors)
{
  robot.urdf = urdf;
  tinyxml2::XMLDocument document;
  if (urdf.find('\0') != std::string::npos)
    errors.push_back("not a text: it has zero bytes");
  else if (document.Parse(urdf.c_str(), urdf.size()) != tinyxml2::XML_SUCCESS)
    errors.push_back(std::string("not XML: ") + document.ErrorStr());
  else if (const XMLElement* root = document.RootElement(); std::string(root->Name()) != "robot")
    errors.push_back(std::string("root element is ") + root->Name() + ": expected robot");
  else if (root->NextSiblingElement())
    errors.push_back("a second root element after the robot: expected one");
  else
  {
    Reader(errors).read(*root, robot);
    return true;
  }
  return false;
}
}  // namespace phri_sim
