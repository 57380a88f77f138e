#pragma once
#include <xmlrpcpp/XmlRpcValue.h>

#include <memory>
#include <string>

#include "hand_source.hpp"
#include "phri_sim/experiment.hpp"

namespace phri_sim
{
/// Private parameters of the experiment node, besides `overrides`.
struct NodeSettings
{
  std::string experiment = "maze_assistance";  ///< name of a file in config/experiments, or a path
  std::string clock = "lockstep";              ///< "lockstep" (as fast as it can) or "realtime"
  double pace = 0.0;                           ///< lockstep no faster than this multiple of real time; 0: no bound
  std::string human = "simulated";             ///< whose hand it is: one of handKinds()
  HandSettings hand;                           ///< of a real one
  std::string model_node = "learner";          ///< node that learns and answers observations; empty: none

  bool realtime() const { return clock == "realtime"; }
};

struct NodeSetup
{
  NodeSettings settings;
  Parameters overrides;
  std::shared_ptr<const Experiment> experiment;
};

/// A parameter tree as a flat map, keys joined by '/'; integers become numbers. Appends what it cannot take to
/// `errors`.
Parameters flatten(XmlRpc::XmlRpcValue tree, std::vector<std::string>& errors);

/// The node's set-up from its tree of private parameters; what is under `overrides/` replaces keys of the experiment's
/// files (see loadExperiment). Throws phri_core::ParameterError listing everything that is wrong anywhere, at once,
/// or PictureError when the scene's picture is all that is wrong; `where` names the node.
NodeSetup loadSetup(const XmlRpc::XmlRpcValue& private_parameters, const std::string& where);
}  // namespace phri_sim
