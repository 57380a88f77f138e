"""The arms, wrist sensors and grippers of the robots. Each arm is a chain of seven revolute joints about z, -y, z, y,
z, -y, z (those of shoulder, elbow and wrist meet in a point each); at 0 it is stretched along its base's z axis."""

from math import pi, radians

from urdf_writer import box, box_inertia, cylinder, cylinder_inertia, sphere

AXES = ((0, 0, 1), (0, -1, 0), (0, 0, 1), (0, 1, 0), (0, 0, 1), (0, -1, 0), (0, 0, 1))
RANGE = tuple(radians(angle) for angle in (170, 120, 170, 120, 170, 120, 170))  # [rad] both ways
VELOCITY = tuple(radians(speed) for speed in (110, 110, 128, 128, 204, 184, 184))  # [rad/s]
TORQUE = 176, 176, 100, 100, 100, 38, 38  # [Nm]
ACROSS = pi / 2, 0, 0  # turns a cylinder's axis from z to y

# KUKA LWR 4+. Heights of the joints' frames above one another: d1 = 0.3105, d3 = 0.4, d5 = 0.39, d7 = 0.078 m, split
# where the published masses and inertias have their frames.
LWR_OFFSETS = 0.102, 0.2085, 0.1915, 0.2085, 0.1915, 0.1985, 0.078
LWR_BODIES = (  # mass, centre, inertia
    (1.210, (-0.0006, 0, 0.0482), (0.00263, 0.00281, 0.00307, 0, 0, 0)),
    (2.303, (0, 0.0233, 0.1181), (0.0156, 0.0153, 0.0044, 0, 0, 0.00319)),
    (2.303, (0, -0.0327, 0.0737), (0.01423, 0.01413, 0.00425, 0, 0, 0.00228)),
    (2.303, (0, -0.0233, 0.1182), (0.01561, 0.01535, 0.00441, 0, 0, -0.00319)),
    (2.303, (0, 0.0327, 0.0737), (0.01423, 0.01413, 0.00425, 0, 0, -0.00228)),
    (1.601, (0, 0.0208, 0.0862), (0.00881, 0.00814, 0.00360, 0, 0, 0.00261)),
    (1.493, (0, -0.0045, -0.0030), (0.00299, 0.00300, 0.00324, 0, 0, 0)),
    (0.109, (0, 0, -0.0158), (4.4e-5, 4.4e-5, 8.7e-5, 0, 0, 0)),
)
LWR_DAMPING = 0.2, 0.18, 0.1, 0.15, 0.12, 0.1, 0.1  # [Nms/rad]
LWR_FRICTION = 1, 1, 1, 1, 0.4, 0.1, 0.1  # [Nm]
LWR_ARMATURE = 3.2, 3.1, 2.0, 2.0, 0.8, 0.4, 0.4  # [kgm2]

LWR_SOURCE = """KUKA LWR 4+, arm {arm}. Lengths, ranges, speeds, torques: public dimensions (d1 0.3105, d3 0.4, d5
       0.39, d7 0.078 m). Masses, centres of mass, inertias, damping, dry friction: a public model of it, with four
       inertias corrected: those of base, link 1 and link 6 were ten times too large for their bodies, that of link
       7 impossible (now a disc of radius 40 mm). Rotor inertia (armature): identification papers, recalled.
       Shapes: own. Origin of {arm}_7_link: the flange's face."""


def lwr_shapes():
    """Visual and collision shapes of the base and the seven links."""
    shell, joint, r = 0.058, 0.064, 0.060
    base = ([(cylinder(0.085, 0.03), (0, 0, 0.015), "dark"), (cylinder(0.068, 0.072), (0, 0, 0.066), "silver")],
            [(cylinder(0.085, 0.03), (0, 0, 0.015)), (cylinder(0.068, 0.07), (0, 0, 0.065))])
    lower = ([(cylinder(shell, 0.15), (0, 0, 0.083), "orange"),
              (cylinder(joint, 0.124), (0, 0, 0.2085, *ACROSS), "orange"),
              (cylinder(0.050, 0.134), (0, 0, 0.2085, *ACROSS), "silver"),
              (cylinder(0.061, 0.012), (0, 0, 0.008), "silver")],
             [(cylinder(r, 0.2), (0, 0, 0.105)), (sphere(0.066), (0, 0, 0.2085))])
    upper = ([(sphere(joint), (0, 0, 0), "orange"), (cylinder(shell, 0.14), (0, 0, 0.1185), "orange"),
              (cylinder(0.061, 0.012), (0, 0, 0.1855), "silver")],
             [(cylinder(r, 0.15), (0, 0, 0.115))])
    fore = ([(cylinder(0.055, 0.13), (0, 0, 0.071), "orange"), (cylinder(0.061, 0.012), (0, 0, 0.008), "silver"),
             (box(0.075, 0.030, 0.09), (0, 0.048, 0.135), "orange"),
             (box(0.075, 0.030, 0.09), (0, -0.048, 0.135), "orange"),
             (cylinder(0.045, 0.126), (0, 0, 0.1985, *ACROSS), "orange")],
            [(cylinder(0.055, 0.115), (0, 0, 0.0625))])
    wrist = ([(sphere(0.057), (0, 0, 0), "silver"), (cylinder(0.040, 0.138), (0, 0, 0, *ACROSS), "silver")],
             [(sphere(0.060), (0, 0, 0))])
    flange = ([(cylinder(0.040, 0.024), (0, 0, -0.012), "dark")], [(cylinder(0.040, 0.024), (0, 0, -0.012))])
    return [base, lower, upper, lower, upper, fore, wrist, flange]


def lwr(urdf, arm, parent, where):
    urdf.source(LWR_SOURCE.format(arm=arm))
    chain(urdf, arm, parent, where, LWR_OFFSETS, LWR_BODIES, lwr_shapes(), LWR_DAMPING, LWR_FRICTION, LWR_ARMATURE)


# The arm of platform 1. Lengths: shoulder 0.15 above the base, upper arm 0.30, forearm 0.28, wrist to tool 0.12 m, of
# which 0.035 m are the wrist sensor. Masses: 3.5 (upper), 2.5 (fore), 1.0 kg (hand), cylinders of even density.
HUMAN_OFFSETS = 0.06, 0.09, 0.15, 0.15, 0.14, 0.14, 0.085
HUMAN_CYLINDERS = (  # mass, radius, length, height of the centre
    (1.5, 0.060, 0.06, 0.03), (1.2, 0.052, 0.12, 0.05), (1.2, 0.048, 0.15, 0.075), (1.1, 0.046, 0.15, 0.075),
    (1.3, 0.044, 0.14, 0.07), (1.2, 0.040, 0.14, 0.07), (0.7, 0.040, 0.07, 0.0), (0.3, 0.036, 0.03, -0.015))
HUMAN_DAMPING = 0.5, 0.5, 0.3, 0.3, 0.15, 0.1, 0.1  # [Nms/rad]
HUMAN_FRICTION = 1, 1, 0.6, 0.6, 0.2, 0.1, 0.1  # [Nm]
HUMAN_ARMATURE = 1.0, 1.0, 0.6, 0.6, 0.2, 0.1, 0.1  # [kgm2]

HUMAN_SOURCE = """Anthropomorphic arm {arm}, a stand-in: we know of no public dimensions of the real one. Assumed:
       upper arm 0.30 m, forearm 0.28 m, wrist to tool 0.12 m (wrist sensor included), 3.5 + 2.5 + 1.0 kg beyond
       the base as cylinders of even density; ranges, speeds, torques like the LWR 4+; damping, friction, rotor
       inertia scaled down from it. Origin of {arm}_7_link: the flange's face."""


def human_shapes():
    base = ([(cylinder(0.062, 0.02), (0, 0, 0.01), "dark"), (cylinder(0.055, 0.05), (0, 0, 0.035), "aluminium")],
            [(cylinder(0.062, 0.06), (0, 0, 0.03))])
    shoulder = ([(cylinder(0.050, 0.07), (0, 0, 0.037), "white"),
                 (cylinder(0.058, 0.12), (0, 0, 0.09, *ACROSS), "white"),
                 (cylinder(0.044, 0.132), (0, 0, 0.09, *ACROSS), "dark")],
                [(cylinder(0.052, 0.08), (0, 0, 0.045)), (sphere(0.06), (0, 0, 0.09))])
    upper = ([(sphere(0.056), (0, 0, 0), "white"), (cylinder(0.048, 0.105), (0, 0, 0.09), "white"),
              (cylinder(0.050, 0.010), (0, 0, 0.145), "dark")],
             [(cylinder(0.05, 0.11), (0, 0, 0.092))])
    elbow = ([(cylinder(0.045, 0.12), (0, 0, 0.06), "white"),
              (cylinder(0.050, 0.106), (0, 0, 0.15, *ACROSS), "white"),
              (cylinder(0.038, 0.118), (0, 0, 0.15, *ACROSS), "dark")],
             [(cylinder(0.048, 0.14), (0, 0, 0.075)), (sphere(0.052), (0, 0, 0.15))])
    fore = ([(sphere(0.048), (0, 0, 0), "white"), (cylinder(0.042, 0.10), (0, 0, 0.08), "white"),
             (cylinder(0.044, 0.010), (0, 0, 0.135), "dark")],
            [(cylinder(0.044, 0.105), (0, 0, 0.085))])
    lower = ([(cylinder(0.039, 0.10), (0, 0, 0.05), "white"),
              (cylinder(0.036, 0.09), (0, 0, 0.14, *ACROSS), "aluminium")],
             [(cylinder(0.040, 0.08), (0, 0, 0.04))])
    wrist = ([(sphere(0.042), (0, 0, 0), "aluminium"), (cylinder(0.030, 0.10), (0, 0, 0, *ACROSS), "dark")],
             [(sphere(0.044), (0, 0, 0))])
    flange = ([(cylinder(0.036, 0.045), (0, 0, -0.0225), "dark")], [(cylinder(0.036, 0.03), (0, 0, -0.015))])
    return [base, shoulder, upper, elbow, fore, lower, wrist, flange]


def human_arm(urdf, arm, parent, where):
    urdf.source(HUMAN_SOURCE.format(arm=arm))
    bodies = [(mass, (0, 0, height), cylinder_inertia(mass, radius, length))
              for mass, radius, length, height in HUMAN_CYLINDERS]
    chain(urdf, arm, parent, where, HUMAN_OFFSETS, bodies, human_shapes(), HUMAN_DAMPING, HUMAN_FRICTION,
          HUMAN_ARMATURE)


def chain(urdf, arm, parent, where, offsets, bodies, shapes, damping, friction, armature):
    urdf.fixed(f"{arm}_base_joint", parent, f"{arm}_base_link", where)
    urdf.link(f"{arm}_base_link", *bodies[0], *shapes[0])
    below = f"{arm}_base_link"
    for k in range(7):
        link = f"{arm}_{k + 1}_link"
        urdf.joint(f"{arm}_{k}_joint", below, link, (0, 0, offsets[k]), axis=AXES[k], limits=(-RANGE[k], RANGE[k]),
                   velocity=VELOCITY[k], effort=TORQUE[k], damping=damping[k], friction=friction[k],
                   armature=armature[k])
        urdf.link(link, *bodies[k + 1], *shapes[k + 1])
        below = link


def hand(urdf, arm):
    """Wrist sensor, tool flange and gripper at the end of an arm."""
    urdf.source(f"""JR3 force/torque sensor: diameter 85 mm, height 35 mm; mass 0.18 kg, assumed. It measures what
       goes through {arm}_ft_joint, about the origin of {arm}_ft_link, the sensor's centre: its own mass counts as
       payload. {arm}_tool0: the face that tools are screwed to.""")
    urdf.fixed(f"{arm}_ft_joint", f"{arm}_7_link", f"{arm}_ft_link", (0, 0, 0.0175))
    urdf.link(f"{arm}_ft_link", 0.18, (0, 0, 0), cylinder_inertia(0.18, 0.0425, 0.035),
              [(cylinder(0.0425, 0.013), (0, 0, -0.011), "blue"), (cylinder(0.040, 0.009), (0, 0, 0), "aluminium"),
               (cylinder(0.0425, 0.013), (0, 0, 0.011), "blue")],
              [(cylinder(0.0425, 0.035), (0, 0, 0))])
    urdf.fixed(f"{arm}_tool0_joint", f"{arm}_ft_link", f"{arm}_tool0", (0, 0, 0.0175))
    urdf.link(f"{arm}_tool0")

    urdf.source("""Schunk PG70. Data sheet: 1.4 kg in all, 0 to 69 mm between the jaws, 83 mm/s, 200 N; public
       model: fingers of 20 g, 0.1 m long, from 78.9 mm above the flange. Width of the body, damping, drive
       inertia: assumed. One drive moves both jaws alike; here they are two joints, each the way of one jaw from
       the middle. gripper_tcp: between the pads of the finger tips, z away from the flange; the jaws move along y.""")
    body = 0.075, 0.118, 0.0785
    urdf.fixed(f"{arm}_gripper_base_joint", f"{arm}_tool0", f"{arm}_gripper_base_link")
    urdf.link(f"{arm}_gripper_base_link", 1.36, (0, 0, 0.039), box_inertia(1.36, *body),
              [(box(*body), (0, 0, 0.0393), "dark"), (box(0.060, 0.118, 0.010), (0, 0, 0.0735), "aluminium"),
               (cylinder(0.0385, 0.012), (0, 0, 0.006), "aluminium")],
              [(box(*body), (0, 0, 0.0393))])
    for side, sign in (("left", 1), ("right", -1)):
        finger = f"{arm}_gripper_{side}_finger"
        urdf.joint(f"{finger}_joint", f"{arm}_gripper_base_link", f"{finger}_link", (0, 0, 0.0789), "prismatic",
                   (0, sign, 0), (0, 0.0345), 0.0415, 200, damping=20, armature=0.5)
        # collision shapes stand back half a millimetre, so that closed fingers do not touch one another
        urdf.link(f"{finger}_link", 0.02, (0, 0.008 * sign, 0.045), box_inertia(0.02, 0.02, 0.016, 0.1),
                  [(box(0.024, 0.024, 0.022), (0, 0.014 * sign, 0.011), "aluminium"),
                   (box(0.020, 0.012, 0.085), (0, 0.008 * sign, 0.0575), "silver"),
                   (box(0.020, 0.002, 0.030), (0, 0.001 * sign, 0.085), "black")],
                  [(box(0.020, 0.0155, 0.099), (0, 0.00825 * sign, 0.0505))])
    urdf.fixed(f"{arm}_gripper_tcp_joint", f"{arm}_gripper_base_link", f"{arm}_gripper_tcp", (0, 0, 0.1639))
    urdf.link(f"{arm}_gripper_tcp")
