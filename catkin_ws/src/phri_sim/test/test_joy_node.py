#!/usr/bin/python3
"""What devices' events become, without a device: events as evdev delivers them."""

import importlib.util
import os
import pathlib

import pytest
from evdev import AbsInfo, ecodes as e

pytest.importorskip("rospy")
_spec = importlib.util.spec_from_file_location("joy_node", pathlib.Path(__file__).parents[1] / "nodes" / "joy_node.py")
joy_node = importlib.util.module_from_spec(_spec)
_spec.loader.exec_module(joy_node)
JoyState, Pacer = joy_node.JoyState, joy_node.Pacer

GAMEPAD = {e.EV_ABS: [(e.ABS_X, AbsInfo(128, 0, 255, 0, 15, 0)), (e.ABS_Y, AbsInfo(128, 0, 255, 0, 15, 0)),
                      (e.ABS_RX, AbsInfo(0, 0, 255, 0, 15, 0))],
           e.EV_KEY: [e.BTN_SOUTH, e.BTN_EAST, e.BTN_START]}
CAP_AXES = (e.ABS_X, e.ABS_Y, e.ABS_Z, e.ABS_RX, e.ABS_RY, e.ABS_RZ)
CAP_ABS = {e.EV_ABS: [(code, AbsInfo(0, -350, 350, 0, 0, 0)) for code in CAP_AXES], e.EV_KEY: [e.BTN_0, e.BTN_1]}
CAP_REL = {e.EV_REL: [e.REL_X, e.REL_Y, e.REL_Z, e.REL_RX, e.REL_RY, e.REL_RZ], e.EV_KEY: [e.BTN_0, e.BTN_1]}
MOUSE = {e.EV_REL: [e.REL_X, e.REL_Y, e.REL_WHEEL], e.EV_KEY: [e.BTN_LEFT, e.BTN_RIGHT, e.BTN_MIDDLE]}
TOUCHPAD = {e.EV_ABS: [(e.ABS_X, AbsInfo(0, 0, 1000, 0, 0, 0)), (e.ABS_Y, AbsInfo(0, 0, 1000, 0, 0, 0))],
            e.EV_KEY: [e.BTN_LEFT, e.BTN_TOUCH, e.BTN_TOOL_FINGER]}
KEYBOARD = {e.EV_KEY: [e.KEY_A, e.KEY_B]}


# [-] s: what is left of a mouse's speed when it counts as settled, and the steps of the integral below
CUT = 1.1 * joy_node.SETTLED * joy_node.MOUSE_DECAY


def codes(capabilities):
    return {kind: [entry[0] if isinstance(entry, tuple) else entry for entry in entries]
            for kind, entries in capabilities.items()}


@pytest.mark.parametrize("capabilities, kind", [
    (GAMEPAD, "joystick"), (CAP_ABS, "space mouse"), (CAP_REL, "space mouse"), (MOUSE, "mouse"), (TOUCHPAD, None),
    (KEYBOARD, None), ({}, None)])
def test_devices_are_told_apart(capabilities, kind):
    assert joy_node.kind_of(codes(capabilities)) == kind
    if kind is None:
        with pytest.raises(ValueError, match="not a joystick"):
            JoyState(capabilities)
    else:
        assert JoyState(capabilities).kind == kind


@pytest.mark.parametrize("code, value, axes", [
    (e.ABS_X, 0, [1.0, 0.0]), (e.ABS_X, 255, [-1.0, 0.0]),  # left, right
    (e.ABS_Y, 0, [0.0, 1.0]), (e.ABS_Y, 255, [0.0, -1.0])])  # forward, back: evdev counts back as positive
def test_signs_of_a_stick(code, value, axes):
    joy = JoyState(GAMEPAD)
    joy.event(e.EV_ABS, code, value, 0.0)
    assert joy.state(0.0)[0] == pytest.approx(axes, abs=0.005)  # the middle of 0 .. 255 lies between two values
    assert joy.state(100.0)[0] == joy.state(0.0)[0], "a stick that is held still sends nothing"


def test_the_dead_zone():
    joy = JoyState(GAMEPAD, deadzone=0.1)
    for value, held in ((128, False), (139, False), (142, True)):  # 0.1 is 12.75 of 127.5
        joy.event(e.EV_ABS, e.ABS_X, value, 0.0)
        axes, _, is_held = joy.state(0.0)
        assert (any(axes), is_held) == (held, held), value


def test_a_stick_that_is_out_of_the_middle_at_the_start():
    out = {**GAMEPAD, e.EV_ABS: [(e.ABS_X, AbsInfo(255, 0, 255, 0, 0, 0)), GAMEPAD[e.EV_ABS][1]]}
    assert JoyState(out).state(0.0)[0] == pytest.approx([-1.0, 0.0], abs=0.005)


def test_buttons_start_and_stop():
    for capabilities, start, stop in ((GAMEPAD, e.BTN_SOUTH, e.BTN_EAST), (CAP_REL, e.BTN_0, e.BTN_1),
                                      (MOUSE, e.BTN_MIDDLE, e.BTN_RIGHT)):
        joy = JoyState(capabilities)
        for code, index in ((start, 0), (stop, 1)):
            joy.event(e.EV_KEY, code, 1, 0.0)
            buttons = joy.state(0.0)[1]
            assert buttons[index] == 1 and sum(buttons) == 1
            joy.event(e.EV_KEY, code, 2, 0.0)  # autorepeat
            assert joy.state(0.0)[1][index] == 1
            joy.event(e.EV_KEY, code, 0, 0.0)
            assert sum(joy.state(0.0)[1]) == 0


@pytest.mark.parametrize("capabilities, kind", [(CAP_ABS, e.EV_ABS), (CAP_REL, e.EV_REL)])
def test_a_space_mouse(capabilities, kind):
    joy = JoyState(capabilities)
    joy.event(kind, e.ABS_X, 175, 0.0)
    joy.event(kind, e.ABS_Y, -350, 0.0)
    joy.event(kind, e.ABS_RZ, 300, 0.0)
    assert joy.state(0.01)[0] == pytest.approx([-0.5, 1.0])


def test_a_cap_that_is_let_go_sends_no_zero():
    joy = JoyState(CAP_REL)
    joy.event(e.EV_REL, e.REL_X, 350, 0.0)
    assert joy.state(0.09)[0] == [-1.0, 0.0]
    assert joy.state(0.11) == ([0.0, 0.0], [0, 0], False)


def test_a_mouse_in_the_hand_moves_by_what_it_was_moved():
    # the integral of the deflection is the way of the mouse over mouse_speed, however its events are spaced
    for events in (1, 4, 20):
        joy = JoyState(MOUSE, deadzone=0.0, mouse_speed=1000.0)
        joy.event(e.EV_KEY, e.BTN_LEFT, 1, 0.0)
        way, dt = 0.0, 0.001
        for k in range(1000):
            if k < 100 and k % (100 // events) == 0:
                joy.event(e.EV_REL, e.REL_Y, -20 // events, k * dt)
            way += joy.state((k + 0.5) * dt)[0][1] * dt
        assert way == pytest.approx(20 / 1000.0, abs=CUT), events


def test_a_mouse_counts_only_while_it_is_gripped():
    joy = JoyState(MOUSE)
    joy.event(e.EV_REL, e.REL_X, 100, 0.0)
    assert joy.state(0.0) == ([0.0, 0.0], [0, 0], False)
    joy = JoyState(MOUSE)
    joy.event(e.EV_KEY, e.BTN_LEFT, 1, 0.0)
    assert joy.state(0.0) == ([0.0, 0.0], [0, 0], True), "gripped and still: it holds on"
    joy.event(e.EV_REL, e.REL_X, 1000, 0.1)
    assert joy.state(0.1)[0] == [-1.0, 0.0], "no more than full"
    joy.event(e.EV_KEY, e.BTN_LEFT, 0, 0.11)
    assert joy.state(0.11) == ([0.0, 0.0], [0, 0], False)


def test_lost_events_let_go():
    joy = JoyState(GAMEPAD)
    joy.event(e.EV_ABS, e.ABS_X, 255, 0.0)
    joy.event(e.EV_KEY, e.BTN_SOUTH, 1, 0.0)
    joy.event(e.EV_SYN, e.SYN_DROPPED, 0, 0.0)
    assert joy.state(0.0) == ([0.0, 0.0], [0, 0, 0], False)
    joy.event(e.EV_ABS, e.ABS_X, 0, 0.1)
    assert joy.state(0.1)[0] == pytest.approx([1.0, 0.0])


def sent_times(states, rate=50.0, repeat=10.0, seconds=2.0):
    pacer, times = Pacer(rate, repeat), []
    for k in range(int(seconds * 1000)):
        if pacer.due(states(k * 0.001), k * 0.001):
            times.append(k * 0.001)
    return times


def test_it_repeats_while_held_and_is_silent_at_rest():
    rest, held = ([0.0, 0.0], [0], False), ([0.0, 1.0], [0], True)
    times = sent_times(lambda t: held if 0.5 <= t < 1.5 else rest)
    inside = [t for t in times if 0.5 <= t < 1.5]
    assert max(b - a for a, b in zip(inside, inside[1:])) <= 0.1 + 1e-9, "10 Hz at least"
    assert 9 <= len(inside) <= 11
    after = [t for t in times if t >= 1.5]
    assert len(after) == 1, "one message tells that it was let go"


def test_no_more_than_the_rate():
    times = sent_times(lambda t: ([0.0, t], [0], True))
    assert min(b - a for a, b in zip(times, times[1:])) >= 0.02 - 1e-9
    assert len(times) == pytest.approx(100, abs=1)


def test_what_helps_when_there_is_no_device(tmp_path):
    with pytest.raises(LookupError, match="has no event devices.*group input"):
        joy_node.find_device("", str(tmp_path))
    with pytest.raises(LookupError, match="/no/such/event0: No such file"):
        joy_node.find_device("/no/such/event0")
    (tmp_path / "event3").touch()
    with pytest.raises(LookupError, match="event3.*group input"):
        joy_node.find_device("", str(tmp_path))


@pytest.mark.skipif(not os.access("/dev/uinput", os.W_OK), reason="/dev/uinput cannot be written")
def test_a_device_of_the_kernel():
    import time

    import evdev
    with evdev.UInput({e.EV_REL: [e.REL_X, e.REL_Y], e.EV_KEY: [e.BTN_LEFT, e.BTN_RIGHT, e.BTN_MIDDLE]},
                      name="test mouse") as mouse:
        time.sleep(0.5)
        device = joy_node.find_device(mouse.device.path)
        joy = JoyState(device.capabilities())
        mouse.write(e.EV_KEY, e.BTN_LEFT, 1)
        mouse.write(e.EV_REL, e.REL_X, 50)
        mouse.syn()
        time.sleep(0.1)
        for event in device.read():
            joy.event(event.type, event.code, event.value, 0.0)
        assert joy.state(0.0)[0][0] < 0.0
