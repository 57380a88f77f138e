#include "stage_sample.hpp"

#include <algorithm>
#include <stdexcept>

namespace phri_sim
{
StageSampler::StageSampler(const Stage& stage, const Experiment& experiment)
  : stage_(dynamic_cast<const TransportStage*>(&stage))
{
  if (!stage_)
    return;
  const TreeModel& model = stage_->world().model();
  if (model.dofs() > StageSample::kMaxJoints)
    throw std::length_error("robot with " + std::to_string(model.dofs()) + " joints: expected at most " +
                            std::to_string(StageSample::kMaxJoints));
  tip_ = model.link(experiment.robot.arm + "_gripper_tcp");
  far_ = model.link("object_human");
}

void StageSampler::before(StageSample& sample) const noexcept
{
  if (!stage_)
    return;
  const World& world = stage_->world();
  sample.joints = world.model().dofs();
  sample.q.head(sample.joints) = world.q();
  sample.qd.head(sample.joints) = world.qd();
  sample.odometry = stage_->robot().odometry();
  sample.base = stage_->robot().base();
  sample.tip = world.linkPose(tip_);
  sample.far = world.linkPose(far_);
  sample.raw = stage_->robot().wrenchRaw();
}

void StageSampler::after(StageSample& sample) const noexcept
{
  if (!stage_)
    return;
  sample.sensed = stage_->sensedWrench();
  sample.person = stage_->humanWrench();
  sample.walked = stage_->partner().intention().walked;
  sample.way = stage_->partner().intention().s;
  const std::vector<Contact>& contacts = stage_->world().contacts();
  sample.contacts = std::min(int(contacts.size()), StageSample::kMaxContacts);
  for (int i = 0; i < sample.contacts; ++i)
    sample.contact[std::size_t(i)] = { contacts[std::size_t(i)].point, contacts[std::size_t(i)].force };
}
}  // namespace phri_sim
