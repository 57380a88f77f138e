#!/usr/bin/python3
"""pybullet: a point mass on two prismatic joints, pushed against a wall, one stepSimulation per millisecond.

Called from Python, as its users do, but with nothing else per step: the push is made by gravity. Physics alone: no
person, no sensor, no policy, no limits, no record.
"""

import statistics
import time

import peer
import pybullet

PUSH = (20.0, 5.0)  # [N] into the wall and along it
SETTLE = 5000  # steps until the mass rests at the wall
CARRIAGE = 1.0  # [kg] of the first joint's link, which Bullet's multibodies cannot do without


def world(admittance):
    mass, damping = admittance["mass"][0], admittance["damping"][0]
    pybullet.connect(pybullet.DIRECT)
    pybullet.setTimeStep(admittance["dt"])
    pybullet.setGravity(PUSH[0] / mass, PUSH[1] / mass, 0)
    box = pybullet.createCollisionShape(pybullet.GEOM_BOX, halfExtents=[0.01, 100, 0.1])
    sphere = pybullet.createCollisionShape(pybullet.GEOM_SPHERE, radius=0.01)
    wall = pybullet.createMultiBody(0, box, basePosition=[0.0201, 0, 0])
    point = pybullet.createMultiBody(
        0,
        linkMasses=[CARRIAGE, mass - CARRIAGE],
        linkCollisionShapeIndices=[-1, sphere],
        linkVisualShapeIndices=[-1, -1],
        linkPositions=[[0, 0, 0]] * 2,
        linkOrientations=[[0, 0, 0, 1]] * 2,
        linkInertialFramePositions=[[0, 0, 0]] * 2,
        linkInertialFrameOrientations=[[0, 0, 0, 1]] * 2,
        linkParentIndices=[0, 1],
        linkJointTypes=[pybullet.JOINT_PRISMATIC] * 2,
        linkJointAxis=[[1, 0, 0], [0, 1, 0]],
    )
    for joint in range(2):
        pybullet.setJointMotorControl2(point, joint, pybullet.VELOCITY_CONTROL, force=0)
        pybullet.changeDynamics(point, joint, linearDamping=0, angularDamping=0, jointDamping=damping,
                                lateralFriction=0)
    pybullet.changeDynamics(wall, -1, lateralFriction=0)
    for _ in range(SETTLE):
        pybullet.stepSimulation()
    return wall, point


def main():
    admittance = peer.read_case()["admittance"]
    wall, point = world(admittance)
    now, step = time.perf_counter_ns, pybullet.stepSimulation

    def measure(seconds):
        empty = []
        for _ in range(20000):
            start = now()
            empty.append(now() - start)
        clock = statistics.median(empty)
        nanoseconds, spent = [], 0
        while spent < 1e9 * seconds or len(nanoseconds) < 2000:
            start = now()
            step()
            elapsed = now() - start
            nanoseconds.append(elapsed)
            spent += elapsed
        if not pybullet.getContactPoints(point, wall):
            raise RuntimeError("no contact with the wall, expected one")
        speed = 1e6 * admittance["dt"] / peer.mean_time(step, seconds)
        return {**peer.percentiles(nanoseconds, clock), "trial_speed": speed}

    peer.serve("pybullet 3.2.7", {}, measure)


if __name__ == "__main__":
    main()
