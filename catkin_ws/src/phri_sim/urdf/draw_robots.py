#!/usr/bin/python3
"""Writes the URDF files of this folder: robots, the objects they hold, mechanisms of the scene.

    draw_robots.py            write them all
    draw_robots.py --check    exit with 1, naming the files, where a shipped one is not what this would write
"""

import pathlib
import sys
from math import pi, radians

from arms import hand, human_arm, lwr
from urdf_writer import Urdf, box, box_inertia, cylinder, cylinder_inertia

FOLDER = pathlib.Path(__file__).resolve().parent
ACROSS = pi / 2, 0, 0  # turns a cylinder's axis from z to y
TILT = radians(54)  # of the arms' bases, outward
SHOULDER = 0.16, 0.25, 1.10  # [m] forward, sideways, above the ground

BASE_LESSON = """
odom is the root; base_x_joint, base_y_joint and base_yaw_joint are the omni-directional base, a point that moves in
the plane. base_x_link and base_y_link have no mass: base_link has all of it. base_link: on the ground, in the
middle of the footprint, x forward. <dynamics> may say `armature`, the rotor inertia at the joint; only our loader
reads it.
"""


def omni_base(urdf, upper_visual, upper_collision):
    urdf.source("""Omni-directional base. Assumed: footprint 0.7 x 0.6 x 0.4 m, 120 kg with computers and batteries
       (a box of even density, 0.6 m high), 0.8 m/s, 1.2 rad/s, a lab of 20 x 20 m, efforts that give at least 0.8
       m/s2.""")
    urdf.link("odom")
    urdf.joint("base_x_joint", "odom", "base_x_link", (), "prismatic", (1, 0, 0), (-10, 10), 0.8, 500)
    urdf.link("base_x_link")
    urdf.joint("base_y_joint", "base_x_link", "base_y_link", (), "prismatic", (0, 1, 0), (-10, 10), 0.8, 500)
    urdf.link("base_y_link")
    urdf.joint("base_yaw_joint", "base_y_link", "base_link", (), "continuous", (0, 0, 1), None, 1.2, 150)
    wheels = []
    for x in (-0.25, 0.25):
        for y in (-0.295, 0.295):
            wheels += [(cylinder(0.10, 0.06), (x, y, 0.10, *ACROSS), "black"),
                       (cylinder(0.055, 0.066), (x, y, 0.10, *ACROSS), "aluminium")]
    deck = [(box(0.70, 0.52, 0.20), (0, 0, 0.17), "dark"), (box(0.70, 0.60, 0.10), (0, 0, 0.26), "dark"),
            (box(0.66, 0.56, 0.09), (0, 0, 0.355), "aluminium"), (box(0.012, 0.50, 0.05), (0.352, 0, 0.17), "blue")]
    urdf.link("base_link", 120, (0, 0, 0.3), box_inertia(120, 0.7, 0.6, 0.6), wheels + deck + upper_visual,
              [(box(0.70, 0.64, 0.38), (0, 0, 0.21))] + upper_collision)


def shoulder_bar(colour):
    """What the arms are bolted to: a bar with a tilted plate at each end."""
    x, y, z = SHOULDER
    visual = [(cylinder(0.06, 2 * y - 0.10), (x, 0, z - 0.03, *ACROSS), colour)]
    collision = [(cylinder(0.06, 2 * y - 0.10), (x, 0, z - 0.03, *ACROSS))]
    for side in (1, -1):
        visual.append((cylinder(0.075, 0.08), (x, side * (y - 0.04), z - 0.025, -side * TILT, 0, 0), colour))
    return visual, collision


def mobile_manipulator():
    urdf = Urdf("mobile_manipulator", "Platform 1: omni-directional base, two human-like arms arm_left and "
                "arm_right, wrist sensors, grippers." + BASE_LESSON)
    bar, bar_collision = shoulder_bar("aluminium")
    chassis = [(box(0.44, 0.46, 0.52), (-0.05, 0, 0.66), "white"), (box(0.30, 0.30, 0.20), (0.02, 0, 1.0), "white"),
               (box(0.10, 0.14, 0.12), (0.11, 0, 1.06), "dark"), (box(0.24, 0.40, 0.06), (-0.05, 0, 0.94), "dark")]
    for k in range(3):  # the computers, from behind
        chassis.append((box(0.02, 0.38, 0.11), (-0.275, 0, 0.50 + 0.15 * k), "black"))
        chassis.append((box(0.01, 0.02, 0.02), (-0.287, 0.15, 0.50 + 0.15 * k), "green"))
    for side in (1, -1):  # the batteries
        chassis.append((box(0.22, 0.04, 0.20), (-0.05, 0.24 * side, 0.55), "blue"))
    omni_base(urdf, chassis + bar,
              [(box(0.46, 0.52, 0.57), (-0.05, 0, 0.685)), (box(0.30, 0.30, 0.17), (0.02, 0, 1.02))] + bar_collision)
    both_arms(urdf, human_arm, "arm")
    return urdf


def dual_lwr():
    urdf = Urdf("dual_lwr", "Platform 2: omni-directional base, two KUKA LWR 4+ lwr_left and lwr_right, "
                "wrist sensors, grippers." + BASE_LESSON)
    bar, bar_collision = shoulder_bar("dark")
    body = [(box(0.20, 0.24, 0.72), (0.06, 0, 0.74), "dark"), (box(0.06, 0.16, 0.66), (0.175, 0, 0.73), "aluminium"),
            (box(0.16, 0.20, 0.10), (0.11, 0, 1.07), "dark")]
    for side in (1, -1):  # the control boxes of the arms, with the maker's colour on the front
        body += [(box(0.36, 0.24, 0.30), (-0.15, 0.15 * side, 0.55), "black"),
                 (box(0.01, 0.20, 0.05), (-0.333, 0.15 * side, 0.64), "orange")]
    body.append((box(0.30, 0.40, 0.12), (-0.17, 0, 0.76), "silver"))  # the computer
    omni_base(urdf, body + bar,
              [(box(0.24, 0.26, 0.74), (0.07, 0, 0.75)), (box(0.38, 0.56, 0.42), (-0.16, 0, 0.61))] + bar_collision)
    both_arms(urdf, lwr, "lwr")
    return urdf


def both_arms(urdf, draw, name):
    urdf.source("Where the arms stand: 0.25 m to each side, 1.1 m up, bases tilted 54 degrees outward: assumed.")
    x, y, z = SHOULDER
    for side, sign in (("left", 1), ("right", -1)):
        arm = f"{name}_{side}"
        draw(urdf, arm, "base_link", (x, sign * y, z, -sign * TILT, 0, 0))
        hand(urdf, arm)


def single_lwr():
    urdf = Urdf("lwr", """
One KUKA LWR 4+ named lwr on a fixed stand, with wrist sensor and gripper: contact tasks, first steps. <dynamics>
may say `armature`, the rotor inertia at the joint; only our loader reads it.""")
    urdf.source("The stand: assumed. The arm's base is 0.7 m above the ground, x forward.")
    urdf.link("odom")
    urdf.fixed("stand_joint", "odom", "base_link")
    urdf.link("base_link", 60, (0, 0, 0.25), box_inertia(60, 0.4, 0.4, 0.7),
              [(box(0.50, 0.50, 0.03), (0, 0, 0.015), "dark"), (cylinder(0.10, 0.64), (0, 0, 0.35), "aluminium"),
               (cylinder(0.13, 0.04), (0, 0, 0.68), "dark"), (cylinder(0.13, 0.04), (0, 0, 0.05), "dark")],
              [(box(0.50, 0.50, 0.03), (0, 0, 0.015)), (cylinder(0.10, 0.67), (0, 0, 0.365))])
    lwr(urdf, "lwr", "base_link", (0, 0, 0.70))
    hand(urdf, "lwr")
    return urdf


def bumper():
    urdf = Urdf("bumper", """
A car's steel bumper. object: where the robot grasps it, x along the bumper towards the person, z up; object_human:
where the person does.""")
    urdf.source("""1.2 m, 1.9 kg, grasps 1.1 m apart: thesis 5.1.2. Inertia: a thin rod, 0.228 kgm2 across; 0.004
       about its own axis (a section of 10 cm). Assumed: its shape, with a tab for the gripper at each end.""")
    length, mass, centre = 1.2, 1.9, 0.55
    across = mass * length**2 / 12
    beam = (0.60, 0.02, 0.09), (centre, 0.03, 0)
    visual = [(box(*beam[0]), beam[1], "steel"), (box(0.56, 0.012, 0.02), (centre, 0.042, 0), "black"),
              (box(0.12, 0.03, 0.03), (centre, 0.035, -0.03), "aluminium")]
    collision = [(box(*beam[0]), beam[1])]
    for side, sign in (("", -1), ("", 1)):  # the ends bend back
        where = centre + sign * 0.395, 0.012, 0, 0, 0, -sign * 0.18
        visual.append((box(0.20, 0.02, 0.09), where, "steel"))
        collision.append((box(0.20, 0.02, 0.09), where))
        visual.append((box(0.11, 0.02, 0.06), (centre + sign * 0.545, 0, 0), "aluminium"))
        collision.append((box(0.11, 0.02, 0.06), (centre + sign * 0.545, 0, 0)))
    urdf.link("object", mass, (centre, 0, 0), (0.004, across, across, 0, 0, 0), visual, collision)
    urdf.fixed("object_human_joint", "object", "object_human", (1.1, 0, 0))
    urdf.link("object_human")
    return urdf


def eraser():
    urdf = Urdf("eraser", """
A whiteboard eraser. object: where the gripper holds it, z out of the gripper, jaws on its sides along y;
object_face: middle of the felt.""")
    urdf.source("A common eraser, 100 x 50 x 45 mm, 80 g: assumed.")
    urdf.link("object", 0.08, (0, 0, 0.0075), box_inertia(0.08, 0.10, 0.05, 0.045),
              [(box(0.10, 0.05, 0.033), (0, 0, 0.0015), "blue"), (box(0.10, 0.05, 0.012), (0, 0, 0.024), "black")],
              [(box(0.10, 0.05, 0.045), (0, 0, 0.0075))])
    urdf.fixed("object_face_joint", "object", "object_face", (0, 0, 0.03))
    urdf.link("object_face")
    return urdf


def button():
    urdf = Urdf("button", """
A push button on a plate. button: middle of the plate's back, z out of the wall or table; button_joint is 0 at rest
and grows as the cap is pressed. The spring and the click (at 2.5 mm) are no part of a URDF: the simulation has
them.""")
    urdf.source("Travel 4 mm: assumed, as are all sizes and the cap's 20 g. For contact the cap is the square "
                "inscribed in it: two boxes touch at up to four points, a cylinder at one, which wanders.")
    urdf.link("button", 0.3, (0, 0, 0.01), box_inertia(0.3, 0.09, 0.09, 0.02),
              [(box(0.09, 0.09, 0.02), (0, 0, 0.01), "dark"), (cylinder(0.034, 0.006), (0, 0, 0.023), "silver")],
              [(box(0.09, 0.09, 0.02), (0, 0, 0.01))])
    urdf.joint("button_joint", "button", "button_cap", (0, 0, 0.026), "prismatic", (0, 0, -1), (0, 0.004), 1.0, 50)
    urdf.link("button_cap", 0.02, (0, 0, 0.006), cylinder_inertia(0.02, 0.025, 0.012),
              [(cylinder(0.025, 0.012), (0, 0, 0.006), "red")], [(box(0.035, 0.035, 0.012), (0, 0, 0.006))])
    return urdf


def whiteboard():
    urdf = Urdf("whiteboard", """
whiteboard: middle of the writing face; z out of the board, x to the right and y up for who reads it.""")
    urdf.source("1.2 x 0.9 m, 20 mm thick, 10 kg: assumed.")
    frame = [(box(1.24, 0.02, 0.022), (0, sign * 0.46, -0.012), "aluminium") for sign in (1, -1)]
    frame += [(box(0.02, 0.94, 0.022), (sign * 0.61, 0, -0.012), "aluminium") for sign in (1, -1)]
    frame.append((box(0.50, 0.015, 0.06), (0, -0.475, 0.02), "aluminium"))
    urdf.link("whiteboard", 10, (0, 0, -0.01), box_inertia(10, 1.2, 0.9, 0.02),
              [(box(1.20, 0.90, 0.02), (0, 0, -0.01), "white")] + frame, [(box(1.20, 0.90, 0.02), (0, 0, -0.01))])
    return urdf


def main():
    drawn = [draw() for draw in (mobile_manipulator, dual_lwr, single_lwr, bumper, eraser, button, whiteboard)]
    stale = []
    for urdf in drawn:
        path, text = FOLDER / f"{urdf.name}.urdf", urdf.text()
        if "--check" not in sys.argv[1:]:
            path.write_text(text)
        elif not path.is_file() or path.read_text() != text:
            stale.append(path.name)
    if stale:
        sys.exit(f"not what draw_robots.py writes: {', '.join(stale)}; run it, and commit what it wrote")


if __name__ == "__main__":
    main()
