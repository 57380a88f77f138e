#!/usr/bin/python3
"""Runs a session: participants x controllers x trials, one bag each, the learner learning in between (or all the time).

Leaves in bag_dir: the bags; session.yaml (seed, configuration, revision, every bag with its SHA-256, ratings);
session.status, one line `<exit code> <reason>`, because roslaunch returns 0 whatever happens.

Exit codes: 0 all trials ran; 65 the scene's picture is unusable; 70 a node died or misbehaved (named), or the session
was interrupted; 74 a bag cannot be written; 78 bad parameters. A trial during which the learner died is repeated once;
what the learner had learned of the block it reads back from its store. A trial that the operator reset is repeated as
often as it is.

Service ~rate (phri_msgs/Rate): how helpful the person found the trial that ended last, 1 to 6; kept in session.yaml.
"""

import hashlib
import json
import os
import pathlib
import sys
import threading
import time

import phri_sim
import rospy
import yaml
from node_parameters import ParameterError, flatten, read
from phri_msgs.srv import Rate, RateResponse, RunTrial, RunTrialRequest, RunTrialResponse
from std_srvs.srv import Trigger

OK, DATA, INTERNAL, IO, CONFIGURATION = 0, 65, 70, 74, 78
# [s] on the wall for a node to offer its services; the imports alone take seconds on a busy machine
START_WAIT = 60.0
RESET_PAUSE = 0.5  # [s]
CODES = {RunTrialResponse.IO_ERROR: IO, RunTrialResponse.BAD_REQUEST: CONFIGURATION}

SCHEMA = {  # key: (default, lowest, highest, meaning)
    "experiment": ("maze_assistance", None, None, "file in config/experiments, or a path"),
    "participants": (0, 0, 100000, "number of people; 0: the experiment's own"),
    "trials": (0, 0, 1000, "per person and controller; 0: the experiment's own"),
    "seed": (-1, -1, 2**31 - 1, "of the study; -1: the experiment's own"),
    "human": ("simulated", None, None, "whose hand moves the object"),
    "participant": (-1, -1, 99999, "only this person; -1: all"),
    "controller": ("", None, None, "only this controller; empty: all"),
    "record": (True, None, None, "write bags"),
    "bag_dir": ("", None, None, "folder for bags and session files"),
    "rating_wait": (0.0, 0.0, 600.0, "[s] after each trial for a person's rating; 0: none is waited for"),
    "bag_prefix": ("", None, None, "first part of the bags' names; empty: the experiment's name"),
    "experiment_node": ("experiment_node", None, None, "name of the node that runs trials"),
    "learner": ("learner", None, None, "name of the node that learns"),
}


class SessionError(Exception):
    """Ends the session with this exit code."""

    def __init__(self, code, reason):
        super().__init__(reason)
        self.code = code


class LearnerLost(Exception):
    """The learner died or has lost something; the trial may be repeated."""


class Session:
    def __init__(self, settings, overrides):
        self.settings, self.overrides = settings, overrides
        self.folder = pathlib.Path(settings["bag_dir"] or ".").resolve()
        self.experiment = phri_sim.Experiment(settings["experiment"], overrides)
        self.configuration = yaml.safe_load(pathlib.Path(self.experiment.path).read_text())
        self.seed = self.experiment.seed if settings["seed"] < 0 else settings["seed"]
        plan = phri_sim.schedule(self.experiment, settings["participants"], settings["trials"], self.seed)
        self.blocks = [block for block in plan if settings["participant"] in (-1, block.participant)
                       and settings["controller"] in ("", block.controller)]
        if not self.blocks:
            raise ParameterError([f"participant {settings['participant']}, controller '{settings['controller']}': not "
                                  f"in experiment {self.experiment.name}; its controllers: "
                                  f"{', '.join(self.experiment.controllers)}"])
        self.total = sum(len(block.trials) for block in self.blocks)
        self.done, self.repeated, self.bags, self.begin = 0, 0, [], time.monotonic()
        self.ended, self.ratings, self.rated = None, {}, threading.Condition()
        self.run_trial = rospy.resolve_name(settings["experiment_node"] + "/run_trial")
        self.learner = rospy.resolve_name(settings["learner"])

    def run(self):
        self.folder.mkdir(parents=True, exist_ok=True)
        self.write("running")
        rospy.Service("~rate", Rate, self.rate)
        self.wait_for(self.run_trial, self.settings["experiment_node"])
        self.wait_for(self.learner + "/learn", self.learner)
        rospy.loginfo("session of %d trials, seed %d, bags in %s", self.total, self.seed,
                      self.folder if self.settings["record"] else "no folder (record is false)")
        for block in self.blocks:
            self.run_block(block)
        self.write("complete")

    def run_block(self, block):
        self.insist(lambda: self.ask("forget"))
        for index, spec in enumerate(block.trials):
            last = index + 1 == len(block.trials)
            response = self.run_once(spec, len(block.trials), index, last)
            if response is None:
                rospy.logwarn("the learner died: trial %d of participant %d under %s is repeated", spec.trial,
                              spec.participant, spec.controller)
                self.repeated += 1
                self.insist(lambda known=index: self.learn(known))
                response = self.run_once(spec, len(block.trials), index, last)
            if response is None:
                raise SessionError(INTERNAL, f"{self.learner} died twice during trial {spec.trial} of participant "
                                             f"{spec.participant} under {spec.controller}")
            self.done += 1
            self.keep(spec, response)

    def run_once(self, spec, trials, known, last):
        """The response of one trial, after which the learner knows known + 1 demonstrations (unless it is the block's
        last trial); None when the learner was lost on the way. What it left is put aside then."""
        predicting = known > 0 or self.experiment.learns_on
        response = self.call_trial(spec, trials, predicting)
        while response.reason == RunTrialResponse.ABORTED:
            time.sleep(RESET_PAUSE)  # at the end of everything the node hears of it before this one
            if rospy.is_shutdown():
                raise SessionError(INTERNAL, "interrupted")
            rospy.loginfo("trial %d of participant %d under %s starts again: %s", spec.trial, spec.participant,
                          spec.controller, response.message)
            response = self.call_trial(spec, trials, predicting)
        if response.reason == RunTrialResponse.PEER_LOST:
            return None
        if not response.success:
            raise SessionError(CODES.get(response.reason, INTERNAL),
                               f"{self.settings['experiment_node']}: {response.message}")
        if last:
            return response
        try:
            self.learn(known + 1)
            return response
        except LearnerLost as error:
            rospy.logwarn("%s", error)
            if response.bag:
                os.rename(response.bag, response.bag + ".superseded")
            return None

    def call_trial(self, spec, trials, use_model):
        request = RunTrialRequest(
            participant=spec.participant, controller=spec.controller, trial=spec.trial, trials=trials,
            practice=spec.practice, study_seed=spec.study_seed, use_model=use_model,
            bag_dir=str(self.folder) if self.settings["record"] else "", bag_prefix=self.settings["bag_prefix"])
        try:
            return rospy.ServiceProxy(self.run_trial, RunTrial)(request)
        except (rospy.ServiceException, rospy.ROSException, OSError) as error:
            if rospy.is_shutdown():
                raise SessionError(INTERNAL, "interrupted") from None
            raise SessionError(INTERNAL, f"{self.settings['experiment_node']} died during trial {spec.trial} of "
                                         f"participant {spec.participant} under {spec.controller} ({error})") from None

    def ask(self, service):
        """The learner's answer as text. Raises LearnerLost."""
        try:
            response = rospy.ServiceProxy(f"{self.learner}/{service}", Trigger)()
        except (rospy.ServiceException, rospy.ROSException, OSError) as error:
            raise LearnerLost(f"{self.learner} did not answer {service}: {error}") from None
        if not response.success:
            raise LearnerLost(f"{self.learner} could not {service}: {response.message}")
        return response.message

    def learn(self, expected):
        """Lets the learner learn from the `expected` demonstrations that it should have."""
        if expected == 0:
            return
        report = json.loads(self.ask("learn"))
        if report["demonstrations"] != expected:
            raise LearnerLost(f"{self.learner} knows {report['demonstrations']} demonstrations, expected {expected}")
        result = (f"{report['primitives']} primitives" if "primitives" in report
                  else f"log-likelihood {report['log_likelihood']:.1f}")
        rospy.loginfo("learned from %d demonstrations in %.2f s, %s", expected, report["seconds"], result)

    def insist(self, act):
        """Does what needs the learner; if it is lost, waits until it is back and tries once more."""
        try:
            self.wait_for(self.learner + "/learn", self.learner)
            act()
        except LearnerLost as error:
            rospy.logwarn("%s", error)
            time.sleep(1.0)  # a dead node is still in the master's list for a moment
            self.wait_for(self.learner + "/learn", self.learner)
            try:
                act()
            except LearnerLost as again:
                raise SessionError(INTERNAL, str(again)) from None

    def wait_for(self, service, node):
        try:
            rospy.wait_for_service(service, timeout=START_WAIT)
        except rospy.ROSException:
            reason = f"{node} does not offer {service} after {START_WAIT:.0f} s"
            if rospy.is_shutdown():
                reason = "interrupted"
            raise SessionError(INTERNAL, reason) from None

    def keep(self, spec, response):
        left = (time.monotonic() - self.begin) / self.done * (self.total - self.done)
        rospy.loginfo("[%d/%d, %d:%02d left] participant %d, %s, trial %d: %s", self.done, self.total, left // 60,
                      left % 60, spec.participant, response.controller, spec.trial, response.message)
        trial = {"participant": spec.participant, "controller": response.controller, "trial": spec.trial,
                 "changed": response.changed}
        routes = self.overrides.get("routes") or self.configuration.get("routes")  # of a transport, one per trial
        route = {"route": routes[(spec.trial - 1) % len(routes)]} if routes else {}
        if response.bag:
            self.bags.append({
                "file": os.path.basename(response.bag), "sha256": checksum(response.bag), **trial, **route,
                "evaluated": spec.evaluated and not response.changed, "completed": response.completed,
                "duration": round(response.duration, 6)})
        with self.rated:
            self.ended = trial
        self.write("running")
        if self.settings["rating_wait"] > 0:
            self.wait_for_rating()

    def wait_for_rating(self):
        """Until the person has rated the trial that just ended, or the time for it is up."""
        end = time.monotonic() + self.settings["rating_wait"]
        with self.rated:
            while tuple(self.ended.values()) not in self.ratings and not rospy.is_shutdown():
                left = end - time.monotonic()
                if left <= 0:
                    rospy.logwarn("trial %d of participant %d was not rated", self.ended["trial"],
                                  self.ended["participant"])
                    return
                self.rated.wait(min(left, 0.5))

    def rate(self, request):
        if not 1 <= request.rating <= 6:
            return RateResponse(False, f"rating {request.rating}: expected 1 (hindered) to 6 (helped)")
        with self.rated:
            if self.ended is None:
                return RateResponse(False, "no trial has ended yet")
            trial = dict(self.ended)
            self.ratings[tuple(trial.values())] = request.rating
            self.rated.notify_all()
        self.write("running")
        return RateResponse(True, f"participant {trial['participant']}, {trial['controller']}, trial {trial['trial']}: "
                                  f"rated {request.rating}")

    def write(self, state):
        with self.rated:
            replace(self.folder / "session.yaml", yaml.safe_dump({
                "state": state, "experiment": self.experiment.name, "seed": self.seed, "trials": self.total,
                "done": self.done, "repeated": self.repeated, "human": self.settings["human"],
                "simulated_participants": self.settings["human"] in ("simulated", "replay"),
                "git_revision": os.environ.get("PHRI_GIT_REVISION") or "unknown", "overrides": self.overrides,
                "configuration": self.configuration, "bags": self.bags,
                "ratings": [{**dict(zip(self.ended, trial)), "rating": rating}
                            for trial, rating in self.ratings.items()],
            }, sort_keys=False))


def checksum(path):
    digest = hashlib.sha256()
    with open(path, "rb") as file:
        for block in iter(lambda: file.read(1 << 20), b""):
            digest.update(block)
    return digest.hexdigest()


def replace(path, text):
    """Writes a file at once: nobody reads a half of it."""
    part = path.with_name(path.name + ".part")
    part.write_text(text)
    part.rename(path)


def run(parameters):
    """(exit code, reason) of the session."""
    try:
        overrides = parameters.pop("overrides", {})
        settings = read(SCHEMA, parameters)
        Session(settings, flatten(overrides)).run()
        return OK, "all trials ran"
    except phri_sim.PictureError as error:
        return DATA, str(error)
    except (ParameterError, ValueError) as error:  # phri_core.ParameterError is a ValueError
        return CONFIGURATION, str(error)
    except SessionError as error:
        return error.code, str(error)
    except OSError as error:
        return IO, str(error)


def main():
    rospy.init_node("session_runner")
    parameters = rospy.get_param("~", {})
    folder = pathlib.Path(str(parameters.get("bag_dir", "")) or ".")
    (folder / "session.status").unlink(missing_ok=True)  # of an earlier session
    try:
        code, reason = run(parameters)
    except Exception as error:  # noqa: B902  whatever it is, the status must say so
        code, reason = INTERNAL, f"{type(error).__name__}: {error}"
    reason = " ".join(reason.split())
    (rospy.logerr if code else rospy.loginfo)("session: exit %d, %s", code, reason)
    try:
        folder.mkdir(parents=True, exist_ok=True)
        replace(folder / "session.status", f"{code} {reason}\n")
    except OSError as error:
        rospy.logerr("session.status: %s", error)
        code = code or IO
    return code


if __name__ == "__main__":
    sys.exit(main())
