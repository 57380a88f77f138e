#!/usr/bin/python3
"""MuJoCo: a point mass on two slide joints, pushed against a wall, one mj_step per millisecond in a loop in C.

Physics alone: no person, no sensor, no policy, no limits, no record. The same mass and damping as the rendered object.
"""

import ctypes
import pathlib
import subprocess
import tempfile

import mujoco
import numpy as np
import peer

SCENE = """<mujoco>
  <option timestep="{dt}" gravity="0 0 0"/>
  <worldbody>
    <geom type="box" size="0.01 100 0.1" pos="0.0201 0 0" condim="1"/>
    <body>
      <joint type="slide" axis="1 0 0" damping="{damping}"/>
      <joint type="slide" axis="0 1 0" damping="{damping}"/>
      <geom type="sphere" size="0.01" mass="{mass}" condim="1"/>
    </body>
  </worldbody>
</mujoco>"""
PUSH = (20.0, 5.0)  # [N] into the wall and along it
BATCH = 1000  # steps per call, in C
SETTLE = 5000  # steps until the mass rests at the wall


def compiled():
    """The function of timed_calls.c."""
    source = pathlib.Path(__file__).with_name("timed_calls.c")
    with tempfile.TemporaryDirectory() as folder:
        library = pathlib.Path(folder) / "timed_calls.so"
        subprocess.run(["gcc", "-O2", "-shared", "-fPIC", "-o", library, source], check=True)
        function = ctypes.CDLL(str(library)).timed_calls
    function.argtypes = [ctypes.c_void_p, ctypes.c_void_p, ctypes.c_void_p, ctypes.c_int64, ctypes.c_void_p]
    function.restype = None
    return function


class World:
    def __init__(self, admittance):
        self.model = mujoco.MjModel.from_xml_string(
            SCENE.format(dt=admittance["dt"], mass=admittance["mass"][0], damping=admittance["damping"][0]))
        self.data = mujoco.MjData(self.model)
        self.data.qfrc_applied[:] = PUSH
        mujoco.mj_step(self.model, self.data, SETTLE)
        self.timed_calls = compiled()
        library = next(pathlib.Path(mujoco.__file__).parent.glob("libmujoco.so*"))
        self.mj_step = ctypes.cast(ctypes.CDLL(str(library)).mj_step, ctypes.c_void_p)
        self.dt = admittance["dt"]

    def times(self, function, count):
        nanoseconds = np.zeros(count, dtype=np.int64)
        self.timed_calls(function, self.model._address, self.data._address, count, nanoseconds.ctypes.data)
        return nanoseconds.tolist()

    def measure(self, seconds):
        clock = float(np.median(self.times(None, 20000)))
        count = 2000
        while sum(nanoseconds := self.times(self.mj_step, count)) < 1e9 * seconds:
            count *= 2
        if self.data.ncon != 1:
            raise RuntimeError(f"{self.data.ncon} contacts, expected the one with the wall")
        step = peer.mean_time(lambda: mujoco.mj_step(self.model, self.data, BATCH), seconds) / BATCH
        return {**peer.percentiles(nanoseconds, clock), "trial_speed": 1e6 * self.dt / step}


def main():
    world = World(peer.read_case()["admittance"])
    peer.serve(f"MuJoCo {mujoco.__version__}", {}, world.measure)


if __name__ == "__main__":
    main()
