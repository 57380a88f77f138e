#!/usr/bin/python3
"""The experiment node and the learner over topics: the same numbers as in process, by the same rules."""

import json
import os
import pathlib
import shutil
import subprocess
import threading
import time
import unittest

import numpy as np
import phri_sim
import rosbag
import rospy
import rostest
from diagnostic_msgs.msg import DiagnosticArray
from phri_msgs.msg import ControllerState, Observation, Trial
from phri_msgs.srv import ListControllers, RunTrial, RunTrialResponse
from roslib.packages import find_node
from rosgraph_msgs.msg import Clock
from std_srvs.srv import Trigger

OVERRIDES = {"timeout": 20.0, "model/states": 12.0}  # as in the .test file
SEED, TRIALS = 11, 2
# the sum of the recorded forces is rounded a few times on its way into a velocity of at most 1 m/s
ROUNDING = 1e-13  # [m/s]
MOTION_LIMITS = 0b111000000  # workspace, velocity, acceleration: the motion is not the admittance's alone
LIMIT = 60.0  # [s] for a process that should end by itself
WRENCHES = ("human", "environment", "assistance", "requested")
COLUMNS = {"tick": ["t", "state", "fault", "limits", "tank", "passivity"], "joint_states": ["x", "y", "vx", "vy"],
           **{f"{name}_wrench": [f"{name}_x", f"{name}_y"] for name in WRENCHES}}


def service(name, kind):
    rospy.wait_for_service(name, 30.0)
    return rospy.ServiceProxy(name, kind)


def run(package, program, *arguments):
    """(exit status, output) of a node that should refuse to start."""
    done = subprocess.run([find_node(package, program)[0], *arguments], stdout=subprocess.PIPE,
                          stderr=subprocess.STDOUT, text=True, timeout=LIMIT)
    return done.returncode, done.stdout


def read(path):
    """The 1 kHz topics of a bag as arrays, the prediction messages, the metadata, the number of messages per topic."""
    data = {"predictions": [], "metadata": [], "stamps": [], "lateness": []}
    rows = {name: [] for name in COLUMNS}
    frames, counts = set(), {}
    with rosbag.Bag(path) as bag:
        for topic, message, _ in bag.read_messages():
            counts[topic] = counts.get(topic, 0) + 1
            name = topic.split("/")[-1]
            if name == "tick":
                data["stamps"].append(message.header.stamp.to_nsec())
                data["lateness"].append(message.lateness)
                rows[name].append([message.t, message.state, message.fault, message.limits, message.tank,
                                   message.passivity])
            elif name == "joint_states":
                assert message.name == ["handle_x", "handle_y"]
                rows[name].append([*message.position, *message.velocity])
            elif name.endswith("_wrench"):
                frames.add(message.header.frame_id)
                rows[name].append([message.wrench.force.x, message.wrench.force.y])
            elif name == "time_hmm":
                data["predictions"].append(message)
            elif name == "map":
                walls = np.where(np.reshape(message.data, (message.info.height, -1)) > 50, "#", ".")
                corner = message.info.origin.position
                data["map"] = {"grid": ["".join(row) for row in walls], "resolution": message.info.resolution,
                               "origin": [corner.x, corner.y]}
            elif name == "metadata":
                data["metadata"].append(json.loads(message.data))
    data.update({name: np.array(values) for name, values in rows.items()}, frames=frames, counts=counts)
    return data


class ExperimentNodeTest(unittest.TestCase):
    @classmethod
    def setUpClass(cls):
        rospy.init_node("test")
        cls.folder = pathlib.Path(rospy.get_param("~folder"))
        shutil.rmtree(cls.folder, ignore_errors=True)
        cls.folder.mkdir(parents=True)
        cls.clock = []
        rospy.Subscriber("/clock", Clock, lambda message: cls.clock.append(message.clock.to_nsec()), queue_size=10000)
        cls.diagnosed = []
        rospy.Subscriber("/diagnostics", DiagnosticArray, lambda message: cls.diagnosed.extend(message.status),
                         queue_size=100)
        cls.experiment = phri_sim.Experiment("maze_assistance_demo", OVERRIDES)
        plan = phri_sim.schedule(cls.experiment, 1, TRIALS, SEED)
        cls.block = next(block for block in plan if block.controller == "lqr")
        learn, forget = service("learner/learn", Trigger), service("learner/forget", Trigger)
        cls.run_trial = staticmethod(service("experiment_node/run_trial", RunTrial))
        cls.forgotten = forget()
        cls.responses, cls.learned = [], []
        for known, spec in enumerate(cls.block.trials):
            cls.responses.append(cls.run_trial(
                spec.participant, spec.controller, spec.trial, TRIALS, spec.practice, SEED, known > 0,
                str(cls.folder), "rostest"))
            cls.learned.append(learn())
        cls.bags = [read(response.bag) if response.bag else None for response in cls.responses]
        cls.tables = phri_sim.run_block(cls.experiment, cls.block)

    def test_trials_ran(self):
        self.assertTrue(self.forgotten.success, self.forgotten.message)
        for response, table in zip(self.responses, self.tables):
            self.assertTrue(response.success, response.message)
            self.assertEqual(response.completed, table.attrs["completed"])
            self.assertEqual(response.observations, -(-len(table) // 20))
        self.assertEqual([json.loads(answer.message)["demonstrations"] for answer in self.learned], [1, 2])

    def test_numbers_equal_those_without_ros(self):
        """Lockstep is exact: the same tick, the same calls of the model, and messages that change no bit."""
        for bag, table in zip(self.bags, self.tables):
            for topic, names in COLUMNS.items():
                np.testing.assert_array_equal(bag[topic], table[names].to_numpy(), err_msg=topic)

    def test_predictions_equal_those_without_ros(self):
        first, second = self.bags
        self.assertEqual(first["predictions"], [])
        table = self.tables[1]
        made = table[table["prediction_t0"].diff().ne(0) & table["prediction_t0"].notna()]
        last = [[m.t0, *np.reshape(m.mean, (-1, 4))[-1, :2], *np.reshape(m.covariance, (-1, 4, 4))[-1, :2, :2].ravel()]
                for m in second["predictions"]]
        names = ["prediction_" + name for name in ("t0", "x", "y", "xx", "xy", "xy", "yy")]
        self.assertGreater(len(made), 100)
        np.testing.assert_array_equal(np.array(last), made[names].to_numpy())

    def test_wrenches_are_exerted_by_the_agent_on_the_object(self):
        """Then their sum, with these signs, is what moves the object: the recorded velocities obey
        v+ = a v + (1 - a) u / D, a = exp(-D dt / M). A turned sign, a swapped axis or a missing force cannot pass."""
        mass, damping, dt = 90.0, 200.0, 0.001
        decay = np.exp(-damping * dt / mass)
        for bag in self.bags:
            force = bag["human_wrench"] + bag["environment_wrench"] + bag["assistance_wrench"]
            free = (bag["tick"][:-1, 3].astype(int) & MOTION_LIMITS) == 0
            self.assertGreater(free.mean(), 0.9)
            velocity = bag["joint_states"][:, 2:]
            expected = decay * velocity[:-1] + (1.0 - decay) * force[:-1] / damping
            np.testing.assert_allclose(velocity[1:][free], expected[free], rtol=0, atol=ROUNDING)

    def test_a_push_along_x_reads_along_x(self):
        """From rest, before anything else acts, the object goes where the hand pushes it."""
        bag = self.bags[0]
        begin = 600  # ticks; the person has begun to push, nothing is touched yet
        self.assertEqual(np.sum(np.abs(bag["environment_wrench"][:begin])), 0.0)
        moved = bag["joint_states"][begin, :2] - bag["joint_states"][0, :2]
        impulse = np.sum(bag["human_wrench"][:begin], axis=0)
        for axis in range(2):
            self.assertGreater(abs(moved[axis]), 1e-4)
            self.assertEqual(np.sign(moved[axis]), np.sign(impulse[axis]))

    def test_bag_holds_what_the_contract_says(self):
        for bag, spec, response, table in zip(self.bags, self.block.trials, self.responses, self.tables):
            ticks = len(bag["tick"])
            self.assertEqual(bag["frames"], {"maze"})
            self.assertTrue(np.all(np.diff(bag["stamps"]) == 10**6))
            self.assertEqual(bag["counts"]["/phri/experiment_node/state"], -(-ticks // 10))
            self.assertEqual(bag["counts"]["/clock"], -(-ticks // 10))
            self.assertEqual(bag["counts"]["/phri/observation"], response.observations)
            first, last = bag["metadata"]
            self.assertFalse(first["completed"])
            self.assertEqual(last["completed"], response.completed)
            self.assertEqual((last["participant"], last["controller"], last["trial"], last["seed"]),
                             (spec.participant, spec.controller, spec.trial, SEED))
            self.assertEqual(last["parameters"]["model/states"], 12.0)
            for key in ("experiment", "scene", "practice", "evaluated", "start", "goal", "turning_point_x",
                        "obstacles"):
                self.assertEqual(last[key], table.attrs[key], key)
            self.assertEqual(bag["map"], table.attrs["map"])
            self.assertEqual(bag["counts"]["/phri/digest"], 1 + ticks // 500)  # every 0.5 s, and at the end
            self.assertEqual(set(bag["lateness"]), {0.0})
            self.assertTrue(last["simulated_participants"])
        self.assertGreater(self.bags[1]["stamps"][0], self.bags[0]["stamps"][-1])

    def test_nothing_is_left_half_written(self):
        self.assertEqual([path.name for path in self.folder.glob("*.active")], [])
        self.assertRegex(os.path.basename(self.responses[0].bag), r"^rostest_p0_lqr_t1_\d{8}T\d{6}Z\.bag$")

    def test_session_time_never_goes_back(self):
        self.assertGreater(len(self.clock), 10)
        self.assertTrue(np.all(np.diff(self.clock) >= 0))

    def test_diagnostics_tell_of_both_nodes(self):
        names = {status.name.split(":")[0].strip("/").split("/")[-1] for status in self.diagnosed}
        self.assertLessEqual({"experiment_node", "learner"}, names)

    def test_bad_requests_run_nothing(self):
        for controller, trial, reason in (("lqrr", 1, 'did you mean "lqr"?'), ("lqr", 3, "trial = 3")):
            response = self.run_trial(0, controller, trial, 2, 0, SEED, False, str(self.folder), "")
            self.assertEqual((response.success, response.reason), (False, RunTrialResponse.BAD_REQUEST))
            self.assertIn(reason, response.message)

    def test_an_unwritable_folder_is_an_io_error(self):
        response = self.run_trial(0, "none", 1, 1, 0, SEED, False, "/proc/no_such_folder", "")
        self.assertEqual(response.reason, RunTrialResponse.IO_ERROR)
        self.assertIn("/proc/no_such_folder", response.message)

    def test_services_between_trials(self):
        for name in ("start", "stop", "reset", "clear_fault"):
            response = service("experiment_node/" + name, Trigger)()
            self.assertEqual((response.success, response.message), (False, "no trial is running"))
        controllers = service("experiment_node/list_controllers", ListControllers)()
        self.assertEqual(controllers.experiment, self.experiment.controllers)
        self.assertIn("pd", controllers.available)
        self.assertEqual(controllers.running, "")

    def test_second_instance_refuses_and_the_first_lives(self):
        status, output = run("phri_sim", "experiment_node", "__name:=experiment_node", "__ns:=/phri",
                             "_experiment:=maze_assistance_demo")
        self.assertEqual(status, 76, output)
        self.assertRegex(output, r"E_NAME_TAKEN node=/phri/experiment_node pid=\d+")
        self.assertEqual(service("experiment_node/list_controllers", ListControllers)().running, "")

    def test_bad_parameters_are_all_listed(self):
        status, output = run("phri_sim", "experiment_node", "__name:=refused", "_experimnt:=x", "_clock:=lockstp",
                             "_overrides/override/robots/admittance/mas:=[50, 50]", "_overrides/model/states:=1")
        self.assertEqual(status, 78, output)
        for text in ("did you mean experiment?", "lockstp", "did you mean admittance/mass?", "model/states"):
            self.assertIn(text, output)

    def test_a_bad_recording_is_bad_data(self):
        cut = self.folder / "cut.bag"
        cut.write_bytes(pathlib.Path(self.responses[0].bag).read_bytes()[:200000])
        for path, text in (("/nowhere/a.bag", "no such file"), (cut, "expected a complete bag of one trial")):
            status, output = run("phri_sim", "experiment_node", "__name:=refused_replay", "_human:=replay",
                                 "_experiment:=maze_assistance_demo", f"_hand/bag:={path}")
            self.assertEqual(status, 65, output)
            self.assertIn("E_HAND", output)
            self.assertIn(text, output)

    def test_a_bad_picture_is_bad_data(self):
        picture = self.folder / "empty.png"
        picture.write_bytes(b"")
        status, output = run("phri_sim", "experiment_node", "__name:=refused_picture",
                             "_experiment:=maze_assistance_demo", f"_overrides/scene:={picture}")
        self.assertEqual(status, 65, output)
        self.assertIn("E_PICTURE", output)
        self.assertIn(str(picture), output)

    def test_a_person_needs_real_time(self):
        status, output = run("phri_sim", "experiment_node", "__name:=refused_clock", "_human:=marker",
                             "_experiment:=maze_assistance_demo")
        self.assertEqual(status, 78, output)
        self.assertIn('expected "realtime" with human = "marker"', output)

    def test_learner_refuses_bad_parameters(self):
        status, output = run("phri_learning", "learner_node.py", "__name:=refused_learner", "_state:=5", "_window:=0")
        self.assertEqual(status, 78, output)
        self.assertIn('state: unknown parameter; did you mean "states"?', output)
        self.assertIn("window = 0", output)

    def test_truncated_model_file(self):
        """At the start: exit 65. While running: refused, and the model in use stays."""
        self.assertTrue(service("learner/save", Trigger)().success)
        model = self.folder / "model.json"
        whole = model.read_text()
        model.write_text(whole[:len(whole) // 2])
        status, output = run("phri_learning", "learner_node.py", "__name:=refused_learner_2", f"_model_path:={model}")
        self.assertEqual(status, 65, output)
        self.assertIn("E_MODEL_FILE", output)
        refused = service("learner/load", Trigger)()
        self.assertFalse(refused.success)
        self.assertIn("E_MODEL_FILE", refused.message)
        response = self.run_trial(0, "none", 1, 1, 0, SEED, True, "", "")
        self.assertTrue(response.success, response.message)
        model.write_text(whole)
        self.assertTrue(service("learner/load", Trigger)().success)

    def test_an_error_in_a_callback_ends_the_learner(self):
        """Row 45 of the fault matrix: rospy alone would log it and live on."""
        self.assertTrue(service("learner/save", Trigger)().success)
        broken = rospy.Publisher("/broken/observation", Observation, queue_size=10)
        learner = subprocess.Popen([find_node("phri_learning", "learner_node.py")[0], "__ns:=/broken",
                                    f"_model_path:={self.folder}/model.json"], stderr=subprocess.PIPE, text=True)
        end = time.monotonic() + LIMIT
        while learner.poll() is None and time.monotonic() < end:
            broken.publish(Observation(t=0.0, state=[1.0, 2.0, 3.0], human_wrench=[1.0]))
            time.sleep(0.05)
        self.assertEqual(learner.wait(1.0), 70)
        self.assertIn("observation has 3 states", learner.communicate()[1])

    def test_an_observation_that_comes_after_the_end_of_its_trial_starts_none(self):
        """Trial and observation come by different connections; a learner that was frozen may see the end first."""
        trials = rospy.Publisher("/late/trial", Trial, queue_size=10)
        observations = rospy.Publisher("/late/observation", Observation, queue_size=10)
        learner = subprocess.Popen([find_node("phri_learning", "learner_node.py")[0], "__ns:=/late"])
        try:
            learn = service("/late/learner/learn", Trigger)
            aborted, late = Trial(phase=Trial.ABORTED), Observation(t=0.0, state=[0.0] * 4, human_wrench=[0.0] * 2)
            aborted.header.stamp, late.header.stamp = rospy.Time(5), rospy.Time(4)
            trials.publish(aborted)
            time.sleep(0.5)
            observations.publish(late)
            time.sleep(0.5)
            self.assertEqual(learn().message, "no demonstration yet")
            late.header.stamp = rospy.Time(5)  # of the next trial
            observations.publish(late)
            time.sleep(0.5)
            self.assertIn("a trial is running", learn().message)
        finally:
            learner.terminate()
            learner.wait(LIMIT)

    def test_real_time_gives_the_numbers_of_lockstep(self):
        """Without predictions, whose arrival is a matter of luck, time on the wall enters no number."""
        response = service("/realtime/experiment_node/run_trial", RunTrial)(
            0, "none", 1, 1, 0, SEED, False, str(self.folder), "realtime")
        self.assertTrue(response.success, response.message)
        bag = read(response.bag)
        table = phri_sim.run_trial("maze_assistance_demo", controller="none", participant=0, seed=SEED, trial=1)
        ticks = len(bag["tick"])
        self.assertEqual(ticks, 1500)  # the timeout of this node's experiment, none lost
        self.assertGreater(min(bag["lateness"]), 0.0)  # a timer never fires early
        for topic, names in COLUMNS.items():
            np.testing.assert_array_equal(bag[topic], table[names].to_numpy()[:ticks], err_msg=topic)

    def test_services_act_on_the_running_trial(self):
        states, answer = [], []
        rospy.Subscriber("/patient/experiment_node/state", ControllerState, lambda m: states.append(m.state))
        run_trial = service("/patient/experiment_node/run_trial", RunTrial)
        trial = threading.Thread(target=lambda: answer.append(
            run_trial(0, "none", 1, 1, 0, SEED, False, str(self.folder), "patient")))

        def wait_for(state):
            end = time.monotonic() + LIMIT
            while (not states or states[-1] != state) and time.monotonic() < end:
                time.sleep(0.02)
            self.assertEqual(states[-1:], [state])

        def call(name):
            response = service("/patient/experiment_node/" + name, Trigger)()
            self.assertTrue(response.success, response.message)

        trial.start()
        wait_for("PASSIVE")
        busy = run_trial(0, "none", 1, 1, 0, SEED, False, "", "")
        self.assertEqual((busy.reason, busy.message), (RunTrialResponse.BAD_REQUEST,
                                                       "a trial is running; one at a time"))
        call("stop")
        wait_for("IDLE")
        call("start")
        wait_for("PASSIVE")
        call("reset")
        trial.join(LIMIT)
        self.assertEqual(answer[0].reason, RunTrialResponse.ABORTED)
        self.assertEqual(len(list(self.folder.glob("patient_*.bag.aborted"))), 1)
        self.assertEqual(list(self.folder.glob("patient_*.bag")), [])


if __name__ == "__main__":
    rostest.rosrun("phri_sim", "experiment_node_test", ExperimentNodeTest)
