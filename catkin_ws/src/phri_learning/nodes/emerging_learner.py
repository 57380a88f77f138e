#!/usr/bin/python3
"""The partner that learns while it interacts, as the learner node uses it, and what it knows as markers for rviz."""

import os
import queue
import threading
from dataclasses import dataclass

import numpy as np
import phri_core
import phri_learning
from geometry_msgs.msg import Point
from visualization_msgs.msg import Marker, MarkerArray

COLOURS = ((0.0, 0.45, 0.7), (0.84, 0.37, 0.0), (0.0, 0.62, 0.45), (0.8, 0.47, 0.65), (0.9, 0.62, 0.0),
           (0.34, 0.71, 0.91))  # of the primitives, Okabe and Ito
NICE = 10  # of the thread that learns: predictions and ticks go first


@dataclass(frozen=True)
class Layout:
    """Where the tree is drawn, and how large [m]."""

    list_at: tuple  # upper middle of the tree, left of the scene
    count_at: tuple  # of the number of segments, below the scene
    line: float  # from line to line
    text: float  # height of a letter
    label: float  # of the numbers at the primitives
    stroke: float  # width of their paths
    height: float  # of the paths above the plane


LAYOUTS = {"maze": Layout((-0.118, 0.132), (0.0, -0.148), 0.009, 0.0065, 0.008, 0.0016, 0.004),
           "odom": Layout((-1.6, 9.5), (-1.6, 9.9), 0.28, 0.2, 0.2, 0.03, 0.03)}


class Emerging:
    """phri_learning.EmergingPartner with its slow half, which learns where it is called or in a thread. `changed` is
    called with the snapshot whenever more is known, `failed` with the error that ended the thread; both may come from
    that thread. `learner`: what is known already; else `demonstrations` are gone through."""

    def __init__(self, settings, demonstrations, changed, failed, learner=None):
        options = emerging_options(settings)
        self.partner = phri_learning.EmergingPartner(options)
        self.learner = learner or phri_learning.PrimitiveLearner(options)
        self.changed, self.failed, self.segments, self.fresh = changed, failed, None, None
        if learner:
            self.partner.adopt(learner.snapshot)
        period, dof = round(settings["dt"] * 1e9), options.dof  # [ns]
        for samples in demonstrations:  # as they came
            self.reset()
            for index, row in enumerate(samples):
                self.observe(phri_core.Observation(index * period * 1e-9, row[:2 * dof], row[2 * dof:], np.zeros(dof)))
                self.study()
        changed(self.learner.snapshot)
        if settings["threaded"]:
            self.segments = queue.SimpleQueue()
            threading.Thread(target=self.work, args=(self.segments,), daemon=True).start()

    def reset(self):
        self.partner.reset()
        self.study()

    def observe(self, observation):
        fresh, self.fresh = self.fresh, None
        if fresh is not None:
            self.partner.adopt(fresh)
        self.partner.observe(observation)

    def predict(self, horizon, dt):
        return self.partner.predict(horizon, dt)

    def study(self):
        """Learns from the segments that have ended since, or hands them to the thread."""
        if self.segments is not None:
            for segment in self.partner.take_segments():
                self.segments.put(segment)
        elif self.partner.learn(self.learner):
            self.changed(self.learner.snapshot)

    def work(self, segments):
        os.setpriority(os.PRIO_PROCESS, threading.get_native_id(), NICE)
        try:
            for segment in iter(segments.get, None):
                self.fresh = self.learner.add(segment)
                self.changed(self.fresh)
        except Exception as error:  # noqa: B902  a dead thread would look like a learner that has nothing to learn
            self.failed(error)

    def end(self):
        if self.segments is not None:
            self.segments.put(None)

    @property
    def primitives(self):
        return len(self.learner.snapshot.nodes)


def emerging_options(settings):
    options = phri_learning.EmergingOptions()
    for name in ("horizon", "reference", "time", "recognition", "states", "window", "members", "cutoff",
                 "window_states"):
        setattr(options, name, settings[name])
    options.dof, options.dt = settings.get("dof", options.dof), settings["learning_dt"]
    cuts = options.segmentation
    cuts.window, cuts.switch_cost, cuts.lag = settings["segment_window"], settings["switch_cost"], settings["lag"]
    if settings.get("scale"):
        cuts.scale = np.array(settings["scale"].split(), float)
    options.segmentation = cuts
    return options


def tree(known, frame="maze"):
    """What is known as markers: the mean path of every primitive with its number over the scene, the branches of the
    tree left of it in the same colours, a line per node; how much was seen at all below the scene."""
    markers, layout = [Marker(action=Marker.DELETEALL)], LAYOUTS[frame]

    def marker(name, kind, index, colour, size):
        m = Marker(ns=name, id=index, type=kind)
        m.pose.orientation.w = 1.0
        m.color.r, m.color.g, m.color.b, m.color.a = *colour, 1.0
        m.scale.x = m.scale.z = size
        markers.append(m)
        return m

    def branch(node, depth):
        entry = library.node(node)
        text = "  " * depth + f"{node}: {entry.count}x, {entry.length:.1f} s"
        return "\n".join([text, *(branch(child, depth + 1) for child in entry.children)])

    library = known.library
    root = marker("primitives", Marker.TEXT_VIEW_FACING, 0, (0.2, 0.2, 0.2), layout.label)
    root.pose.position = Point(*layout.count_at, 5 * layout.height)
    root.text = f"{library.node(0).count} segments seen"
    top = layout.list_at[1]
    for index, node in enumerate(library.upper_nodes):
        colour = COLOURS[index % len(COLOURS)]
        places = library.node(node).output[:, :2]
        path = marker("primitive paths", Marker.LINE_STRIP, index, colour, layout.stroke)
        path.points = [Point(x, y, layout.height) for x, y in places]
        label = marker("primitives", Marker.TEXT_VIEW_FACING, index + 1, (0.2, 0.2, 0.2), layout.label)
        label.pose.position = Point(*places[len(places) // 2], 5 * layout.height)
        label.text = str(node)
        entry = marker("primitive tree", Marker.TEXT_VIEW_FACING, index, colour, layout.text)
        entry.text = branch(node, 0)
        height = layout.line * (entry.text.count("\n") + 1)
        entry.pose.position = Point(layout.list_at[0], top - 0.5 * height, 5 * layout.height)
        top -= height
    for m in markers:
        m.header.frame_id = frame
    return MarkerArray(markers=markers)
