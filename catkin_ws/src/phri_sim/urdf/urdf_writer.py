"""Links, joints and primitive shapes as URDF text, and the inertias of bodies of even density. SI units; a pose is up
to six numbers x y z [m], roll pitch yaw [rad]; an inertia is (xx, yy, zz, xy, xz, yz) about the centre of mass."""

import textwrap

COLOURS = {
    "orange": (0.95, 0.40, 0.05),
    "silver": (0.78, 0.79, 0.81),
    "white": (0.93, 0.93, 0.91),
    "aluminium": (0.62, 0.64, 0.67),
    "steel": (0.47, 0.50, 0.54),
    "dark": (0.20, 0.21, 0.23),
    "black": (0.07, 0.07, 0.08),
    "blue": (0.13, 0.27, 0.52),
    "green": (0.20, 0.55, 0.30),
    "red": (0.80, 0.10, 0.08),
}


def wrapped(text, first, others):
    return textwrap.wrap(" ".join(text.split()), 118, initial_indent=first, subsequent_indent=others)


def number(value):
    return f"{value:.9g}" if abs(value) > 1e-12 else "0"


def numbers(values):
    return " ".join(number(value) for value in values)


def box(x, y, z):
    return f'<box size="{numbers((x, y, z))}"/>'


def cylinder(radius, length):
    return f'<cylinder radius="{number(radius)}" length="{number(length)}"/>'


def sphere(radius):
    return f'<sphere radius="{number(radius)}"/>'


def box_inertia(mass, x, y, z):
    return (mass * (y * y + z * z) / 12, mass * (x * x + z * z) / 12, mass * (x * x + y * y) / 12, 0, 0, 0)


def cylinder_inertia(mass, radius, length, axis=2):
    across, along = mass * (3 * radius**2 + length**2) / 12, mass * radius**2 / 2
    return tuple(along if k == axis else across for k in range(3)) + (0, 0, 0)


def pose(values):
    values = tuple(values) + (0,) * (6 - len(values))
    turn = f' rpy="{numbers(values[3:])}"' if any(values[3:]) else ""
    return f'<origin xyz="{numbers(values[:3])}"{turn}/>'


class Urdf:
    """Collects the elements of one robot; `text()` is the file."""

    def __init__(self, name, lesson):
        self.name, self.lesson = name, lesson
        self.lines, self.colours = [], []

    def source(self, comment):
        """Where the numbers of the elements that follow come from."""
        self.lines += ["", *wrapped(f"<!-- {comment} -->", "  ", "       ")]

    def link(self, name, mass=0.0, centre=(0, 0, 0), inertia=(0,) * 6, visual=(), collision=()):
        """`visual`: (shape, pose, colour); `collision`: (shape, pose)."""
        if not (mass or visual or collision):
            self.lines.append(f'  <link name="{name}"/>')
            return
        self.lines.append(f'  <link name="{name}">')
        if mass:
            keys = "ixx iyy izz ixy ixz iyz".split()
            moments = " ".join(f'{key}="{number(value)}"' for key, value in zip(keys, inertia))
            self.lines += [f'    <inertial>{pose(centre)}<mass value="{number(mass)}"/>',
                           f"      <inertia {moments}/></inertial>"]
        for shape, where, colour in visual:
            if colour not in self.colours:
                self.colours.append(colour)
            self.lines += [f"    <visual>{pose(where)}",
                           f'      <geometry>{shape}</geometry><material name="{colour}"/></visual>']
        for shape, where in collision:
            self.lines += [f"    <collision>{pose(where)}", f"      <geometry>{shape}</geometry></collision>"]
        self.lines.append("  </link>")

    def fixed(self, name, parent, child, where=()):
        self.lines += [f'  <joint name="{name}" type="fixed">',
                       f'    <parent link="{parent}"/><child link="{child}"/>{pose(where)}</joint>']

    def joint(self, name, parent, child, where=(), kind="revolute", axis=(0, 0, 1), limits=None, velocity=0.0,
              effort=0.0, damping=0.0, friction=0.0, armature=0.0):
        """`limits`: (lower, upper), or None for a continuous joint. `armature` is an attribute of ours: rotor inertia
        at the joint, which URDF has no word for; other readers pass over it."""
        bounds = f'lower="{number(limits[0])}" upper="{number(limits[1])}" ' if limits else ""
        more = f' armature="{number(armature)}"' if armature else ""
        self.lines += [
            f'  <joint name="{name}" type="{kind}">',
            f'    <parent link="{parent}"/><child link="{child}"/>',
            f'    {pose(where)}<axis xyz="{numbers(axis)}"/>',
            f'    <limit {bounds}velocity="{number(velocity)}" effort="{number(effort)}"/>',
            f'    <dynamics damping="{number(damping)}" friction="{number(friction)}"{more}/></joint>',
        ]

    def text(self):
        head = ['<?xml version="1.0"?>', "<!--", "  Written by draw_robots.py: change that, not this file.",
                *wrapped(self.lesson, "  ", "  "), "-->",
                f'<robot name="{self.name}">']
        colours = [f'  <material name="{colour}"><color rgba="{numbers(COLOURS[colour])} 1"/></material>'
                   for colour in self.colours]
        return "\n".join(head + colours + self.lines + ["</robot>", ""])
