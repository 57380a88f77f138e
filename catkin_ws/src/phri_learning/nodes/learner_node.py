#!/usr/bin/python3
"""Learns from the trials of a block and predicts at 50 Hz: a time-based HMM of whole trials, learned between them (kind
time_hmm), or movement primitives, found and learned while they are made (kind emerging).

Subscribes `observation` (phri_msgs/Observation) and `trial` (phri_msgs/Trial). A trial that was seen from its first
observation to its last is a demonstration [x; xdot; u_h], (T, 3 dof). Publishes `prediction/time_hmm` for every
observation while a model is loaded, with the observation's stamp; empty while the model cannot tell.

Kind emerging learns after every observation, within the callback, or with `threaded` (real time) in a thread of its own
while predictions go on. Publishes `learner/primitives` (visualization_msgs/MarkerArray, latched) with each change: the
primitives as lines over the scene, the tree as text beside them.

Services (std_srvs/Trigger): ~learn fits a model on all demonstrations of the block and answers, when it is in use, with
JSON {demonstrations, log_likelihood or primitives, seconds}; predictions go on from the old model meanwhile. ~forget
begins a new block with nothing learned and reads the parameters again (the experiment node puts the experiment's
settings there). ~save and ~load a model file, model_path.

Demonstrations outlive the process in `store`: at most the one of the running trial is lost with it. A restarted learner
answers from the next trial on, for it has not seen the beginning of the running one; of kind emerging it goes through
the demonstrations again, which in lockstep leaves it as it was. What it learned of a trial that the operator aborted
stays: the person did move so.

Exit codes: 0 ended by a signal, 65 unusable model file, 70 error in a callback, 78 bad parameters.
"""

import json
import os
import sys
import threading
import time
import traceback

import numpy as np
import phri_core
import phri_learning
import rospy
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue
from node_parameters import ParameterError, read
from phri_msgs.msg import Observation, Prediction, Trial
from std_srvs.srv import Trigger, TriggerResponse
from visualization_msgs.msg import MarkerArray

sys.path.insert(0, os.path.dirname(os.path.realpath(__file__)))  # the sources' folder, where catkin's wrapper is not
from emerging_learner import Emerging, emerging_options, tree  # noqa: E402

INTERNAL, DATA, CONFIGURATION = 70, 65, 78
END_WAIT = 5.0  # [s] on the wall for the end of a trial, and its last observations, to arrive before learning
QUEUE = 10000  # observations of a long trial: without a model nothing waits for this node

SCHEMA = {  # key: (default, lowest, highest, meaning)
    "kind": ("time_hmm", None, None, "time_hmm, learned between trials, or emerging, learned during them"),
    "states": (40, 2, 1000, "states of the HMM, of each primitive"),
    "reference": ("path", None, None, "path or displacement: what a prediction refers to"),
    "time": ("entry_corrected", None, None, "thesis, entry_corrected or regressed: progress in the model"),
    "recognition": ("position", None, None, "position, motion or all: what tells the progress"),
    "adapt_pace": (False, None, None, "model time passes at the observed pace"),
    "window": (30, 1, 1000, "[samples] that recognition looks back"),
    "horizon": (0.2, 0.02, 5.0, "[s] of the predictions"),
    "dt": (0.02, 0.005, 0.1, "[s] between observations, and step of the predictions"),
    "dof": (2, 1, 6, "of the task: coordinates of the object"),
    "frame": ("maze", None, None, "maze or odom: what the observations are expressed in"),
    "learning_dt": (0.05, 0.005, 1.0, "[s] emerging: between the samples learned from"),
    "members": (3, 2, 100, "emerging: segments that make a primitive"),
    "cutoff": (0.6, 0.01, 0.99, "emerging: K_cut of the clustering"),
    "window_states": (20, 2, 1000, "emerging: states of the window HMM, even"),
    "segment_window": (24, 2, 1000, "[samples] emerging: W of the segmentation"),
    "switch_cost": (9.5, 1e-3, 1e6, "emerging: C of the segmentation"),
    "lag": (35, 1, 1000, "[samples] emerging: a boundary rests before it is final"),
    "scale": ("", None, None, "emerging: size of each coordinate of [x; xdot] for the segmentation, a text of numbers"),
    "threaded": (False, None, None, "emerging: learn in a thread of its own, for real time"),
    "model_path": ("", None, None, "model file: loaded at the start if it exists; of ~save and ~load"),
    "store": ("", None, None, "file that keeps the block's demonstrations; empty: none"),
}
CHOICES = {"frame": ("maze", "odom"), "kind": ("time_hmm", "emerging"), "reference": ("path", "displacement"),
           "time": ("thesis", "entry_corrected", "regressed"), "recognition": ("position", "motion", "all")}


class Demonstrations:
    """The block's demonstrations, and on disk what they were before this process ended."""

    def __init__(self, path):
        self.path, self.all = path, []
        if path and os.path.exists(path):
            try:
                with np.load(path) as file:
                    self.all = [file[name] for name in sorted(file.files)]
            except (OSError, ValueError, KeyError, EOFError) as error:
                rospy.logwarn("%s: %s; starting without demonstrations", path, error)

    def add(self, samples):
        self.all.append(np.array(samples))
        self._write()

    def clear(self):
        self.all = []
        self._write()

    def _write(self):
        if not self.path:
            return
        part = self.path + ".part"
        with open(part, "wb") as file:
            np.savez(file, **{f"d{index:06d}": values for index, values in enumerate(self.all)})
        os.replace(part, self.path)


class Learner:
    def __init__(self, settings):
        self.settings = settings
        self.lock = threading.Condition()
        self.demonstrations = Demonstrations(settings["store"])
        self.hmm = self.model = None
        self.samples, self.whole, self.announced = [], False, None
        self.aborted = rospy.Time(0)  # session time up to which all observations are of aborted trials
        self.exit_code, self.error = 0, ""
        self.primitives = rospy.Publisher("learner/primitives", MarkerArray, queue_size=5, latch=True)
        if settings["model_path"] and os.path.exists(settings["model_path"]):
            self.read_model()
        elif self.emerging:
            self.model = self.emerge(self.demonstrations.all)

    @property
    def emerging(self):
        return self.settings["kind"] == "emerging"

    def emerge(self, demonstrations, learner=None):
        frame = self.settings["frame"]
        return Emerging(self.settings, demonstrations, lambda known: self.primitives.publish(tree(known, frame)),
                        self.fail, learner)

    def read_model(self):
        path = self.settings["model_path"]
        if not self.emerging:
            self.use(phri_learning.TimeHmm.from_json(path))
            return
        learner = phri_learning.PrimitiveLearner.from_json(emerging_options(self.settings), path)
        with self.lock:
            self.model = self.emerge([], learner)

    def use(self, hmm):
        names = ("dof", "window", "reference", "time", "recognition", "adapt_pace")
        model = phri_learning.TimeHmmModel(hmm, **{name: self.settings[name] for name in names})
        with self.lock:
            self.hmm, self.model = hmm, model

    def start(self):
        rospy.Subscriber("trial", Trial, self.guarded(self.on_trial), queue_size=100, tcp_nodelay=True)
        observations = rospy.Subscriber("observation", Observation, self.guarded(self.on_observation), queue_size=QUEUE,
                                        tcp_nodelay=True)
        # who sees this publisher may rely on its listening
        while observations.get_num_connections() == 0 and not rospy.is_shutdown():
            time.sleep(0.02)
        self.predictions = rospy.Publisher("prediction/time_hmm", Prediction, queue_size=100, tcp_nodelay=True)
        for name in ("learn", "forget", "save", "load"):
            rospy.Service("~" + name, Trigger, self.guarded(getattr(self, name)))
        self.diagnostics = rospy.Publisher("/diagnostics", DiagnosticArray, queue_size=5)
        threading.Thread(target=self.report, daemon=True).start()
        rospy.loginfo("ready, %d demonstrations, %s", len(self.demonstrations.all),
                      "a model from " + self.settings["model_path"] if self.model else "no model")

    def guarded(self, callback):
        """rospy would log an exception of a callback and live on without it having been handled."""
        def call(*arguments):
            try:
                return callback(*arguments)
            except Exception as error:  # noqa: B902
                self.fail(error)
                return None
        return call

    def fail(self, error):
        rospy.logfatal("%s\n%s", error, traceback.format_exc())
        self.exit_code, self.error = INTERNAL, f"{type(error).__name__}: {error}"
        self.report_once()
        rospy.signal_shutdown("error in a callback")

    def on_observation(self, message):
        with self.lock:
            if message.header.stamp < self.aborted:
                return  # came by its own connection after the news that its trial is worth nothing
            if message.t == 0.0:
                self.samples, self.whole, self.announced = [], True, None
                if self.model:
                    self.model.reset()
            if not self.whole:
                return
            self.samples.append([*message.state, *message.human_wrench])
            if self.model:
                self.predictions.publish(self.predict(message))
                if self.emerging:
                    self.model.study()
            self.end_of_trial()

    def predict(self, message):
        """In the order of a trial in process: observe, then predict."""
        self.model.observe(phri_core.Observation(message.t, np.array(message.state), np.array(message.human_wrench),
                                                 np.array(message.environment_wrench)))
        belief = self.model.predict(self.settings["horizon"], self.settings["dt"])
        answer = Prediction(model=self.settings["kind"])
        answer.header = message.header
        if belief is None:
            return answer
        answer.t0, answer.dt = belief.t0, belief.dt
        answer.state_size, answer.mean, answer.covariance = lists(belief.desired_state)
        answer.wrench_size, answer.wrench_mean, answer.wrench_covariance = lists(belief.human_wrench)
        return answer

    def on_trial(self, message):
        with self.lock:
            if message.phase == Trial.FINISHED:
                self.announced = message.observations
                self.end_of_trial()
            elif message.phase == Trial.ABORTED:
                self.aborted = message.header.stamp
                self.samples, self.whole, self.announced = [], False, None
                self.lock.notify_all()

    def end_of_trial(self):
        """The end and the last observations come by different connections, in any order."""
        if self.whole and self.announced is not None and len(self.samples) >= self.announced:
            self.demonstrations.add(self.samples)
            self.samples, self.whole, self.announced = [], False, None
            self.lock.notify_all()

    def learn(self, _):
        with self.lock:
            if not self.lock.wait_for(lambda: not self.whole, END_WAIT):
                return TriggerResponse(False, "a trial is running, or its end did not arrive")
            known = list(self.demonstrations.all)
        if not known:
            return TriggerResponse(False, "no demonstration yet")
        start = time.monotonic()
        if self.emerging:
            with self.lock:
                self.model.reset()
            return TriggerResponse(True, json.dumps({"demonstrations": len(known), "primitives": self.model.primitives,
                                                     "seconds": time.monotonic() - start}))
        hmm = phri_learning.TimeHmm(self.settings["states"], dt=self.settings["dt"]).fit(known)
        likelihood = sum(hmm.score(demonstration) for demonstration in known)
        self.use(hmm)
        return TriggerResponse(True, json.dumps({"demonstrations": len(known), "log_likelihood": likelihood,
                                                 "seconds": time.monotonic() - start}))

    def forget(self, _):
        try:
            settings = read_settings()
        except ParameterError as error:
            return TriggerResponse(False, f"parameters refused: {error}")
        with self.lock:
            self.settings = settings
            self.demonstrations.clear()
            if isinstance(self.model, Emerging):
                self.model.end()
            self.hmm = None
            self.model = self.emerge([]) if self.emerging else None
            self.samples, self.whole, self.announced = [], False, None
            self.lock.notify_all()
        return TriggerResponse(True, "nothing known")

    def save(self, _):
        path, model = self.settings["model_path"], self.model.learner if self.emerging else self.hmm
        if not path or model is None:
            return TriggerResponse(False, "no model to save" if path else "model_path is empty")
        model.to_json(path)
        return TriggerResponse(True, path)

    def load(self, _):
        path = self.settings["model_path"]
        if not path:
            return TriggerResponse(False, "model_path is empty")
        try:
            self.read_model()
        except (phri_learning.ModelFileError, ValueError) as error:
            rospy.logerr("%s; the previous model stays", error)
            return TriggerResponse(False, str(error))
        return TriggerResponse(True, path)

    def report(self):
        while not rospy.is_shutdown():
            self.report_once()
            time.sleep(1.0)

    def report_once(self):
        status = DiagnosticStatus(name=rospy.get_name() + ": learner", hardware_id="none",
                                  level=DiagnosticStatus.ERROR if self.error else DiagnosticStatus.OK,
                                  message=self.error or ("predicting" if self.model else "nothing learned"))
        status.values = [KeyValue("demonstrations", str(len(self.demonstrations.all))),
                         KeyValue("primitives", str(getattr(self.model, "primitives", "none"))),
                         KeyValue("samples of the running trial", str(len(self.samples)))]
        message = DiagnosticArray(status=[status])
        message.header.stamp = rospy.Time.now()
        self.diagnostics.publish(message)


def read_settings():
    settings = read(SCHEMA, rospy.get_param("~", {}))
    errors = [f"{key} = {settings[key]!r}: expected one of {', '.join(choices)}" for key, choices in CHOICES.items()
              if settings[key] not in choices]
    if errors:
        raise ParameterError(errors)
    return settings


def lists(gaussians):
    """Size, means and covariances, row-major, of a list of Gaussians."""
    if not gaussians:
        return 0, [], []
    return (len(gaussians[0].mean), np.concatenate([g.mean for g in gaussians]).tolist(),
            np.concatenate([g.covariance.ravel() for g in gaussians]).tolist())


def main():
    rospy.init_node("learner")
    try:
        learner = Learner(read_settings())
    except ParameterError as error:
        rospy.logfatal("%s: %s", rospy.get_name(), error)
        return CONFIGURATION
    except (phri_learning.ModelFileError, ValueError) as error:
        rospy.logfatal("%s", error)
        return DATA
    learner.start()
    while not rospy.is_shutdown():  # rospy.spin, but on the wall's clock
        time.sleep(0.1)
    return learner.exit_code


if __name__ == "__main__":
    sys.exit(main())
