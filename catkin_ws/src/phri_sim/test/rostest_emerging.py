#!/usr/bin/python3
"""Emerging assistance over topics: the learner learns in its own process while the trial runs, and in lockstep every
number is the one without ROS."""

import json
import pathlib
import shutil
import time
import unittest

import numpy as np
import phri_sim
import rospy
import rostest
from phri_msgs.srv import RunTrial
from rostest_experiment_node import COLUMNS, read, service
from std_srvs.srv import Trigger
from visualization_msgs.msg import Marker, MarkerArray

OVERRIDES = {"model/learning/members": 2.0, "assistance_off": [4.0]}  # as in the .test file: soon something to predict
SEED, TRIALS = 11, 4
ARRIVAL = 5.0  # [s] on the wall for a message


class EmergingTest(unittest.TestCase):
    @classmethod
    def setUpClass(cls):
        rospy.init_node("test")
        folder = pathlib.Path(rospy.get_param("~folder"))
        shutil.rmtree(folder, ignore_errors=True)
        folder.mkdir(parents=True)
        cls.pictures = []
        rospy.Subscriber("learner/primitives", MarkerArray, cls.pictures.append, queue_size=100)
        experiment = phri_sim.Experiment("emerging_assistance", OVERRIDES)
        block = phri_sim.schedule(experiment, 1, TRIALS, SEED)[0]
        learn, forget = service("learner/learn", Trigger), service("learner/forget", Trigger)
        run_trial = service("experiment_node/run_trial", RunTrial)
        cls.forgotten, cls.responses, cls.learned = forget(), [], []
        for spec in block.trials:
            cls.responses.append(run_trial(spec.participant, spec.controller, spec.trial, TRIALS, spec.practice, SEED,
                                           True, str(folder), "rostest"))
            cls.learned.append(learn())
        cls.bags = [read(response.bag) for response in cls.responses]
        cls.tables = phri_sim.run_block(experiment, block)

    def test_trials_ran_and_the_learner_heard_all_of_them(self):
        self.assertTrue(self.forgotten.success, self.forgotten.message)
        for response in self.responses:
            self.assertTrue(response.success and response.completed, response.message)
        reports = [json.loads(answer.message) for answer in self.learned]
        self.assertEqual([report["demonstrations"] for report in reports], list(range(1, TRIALS + 1)))
        self.assertGreater(reports[-1]["primitives"], 3)

    def test_numbers_equal_those_without_ros(self):
        for bag, table in zip(self.bags, self.tables):
            for topic, names in COLUMNS.items():
                np.testing.assert_array_equal(bag[topic], table[names].to_numpy(), err_msg=topic)

    def test_predictions_equal_those_without_ros_and_begin_with_the_first_primitive(self):
        self.assertEqual([message for message in self.bags[0]["predictions"] if message.mean], [])
        for bag, table in zip(self.bags[1:], self.tables[1:]):
            made = table[table["prediction_t0"].diff().ne(0) & table["prediction_t0"].notna()]
            last = [[m.t0, *np.reshape(m.mean, (-1, 4))[-1, :2],
                     *np.reshape(m.covariance, (-1, 4, 4))[-1, :2, :2].ravel()] for m in bag["predictions"] if m.mean]
            names = ["prediction_" + name for name in ("t0", "x", "y", "xx", "xy", "xy", "yy")]
            np.testing.assert_array_equal(np.reshape(last, (-1, 7)), made[names].to_numpy())
        self.assertGreater(len(last), 100)
        self.assertEqual({m.model for m in self.bags[-1]["predictions"] if m.mean}, {"emerging"})

    def test_without_assistance_there_is_no_force_and_the_bag_says_so(self):
        assisted, alone = self.bags[2:]
        self.assertGreater(np.abs(assisted["assistance_wrench"]).max(), 1.0)
        self.assertEqual(np.abs(alone["assistance_wrench"]).max(), 0.0)
        self.assertEqual([bag["metadata"][-1]["assistance_off"] for bag in self.bags], [False] * 3 + [True])
        for bag, table in zip(self.bags, self.tables):
            for key in ("path", "pace", "assistance_off"):
                self.assertEqual(bag["metadata"][-1][key], table.attrs[key])

    def test_the_growing_tree_is_shown(self):
        end = time.monotonic() + ARRIVAL
        known = int(self.tables[-1].attrs["primitives"])

        def lines():
            return [sum(m.type == Marker.LINE_STRIP for m in picture.markers) for picture in self.pictures]

        # reset by ~learn after the last trial commits what was open, which may add a primitive
        while not lines() or lines()[-1] < known:
            self.assertLess(time.monotonic(), end, f"{lines()} primitives shown, expected {known}")
            time.sleep(0.05)
        self.assertEqual(lines()[0], 0)
        self.assertEqual(lines()[-1], json.loads(self.learned[-1].message)["primitives"])


if __name__ == "__main__":
    rostest.rosrun("phri_sim", "emerging", EmergingTest)
