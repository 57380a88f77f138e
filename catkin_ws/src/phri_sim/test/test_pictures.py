#!/usr/bin/python3
"""Pictures as other programs write them, the largest allowed ones, and pictures made to hurt."""

import base64
import io
import json
import os
import struct
import subprocess
import sys
import zlib
from pathlib import Path

import numpy as np
import phri_sim
import pytest
from PIL import Image, ImageDraw

MEMORY = 256  # [MB] that loading a picture may take, both processes together
LARGEST = 4096  # [pixel]
SHARE = Path(__file__).parent.parent
START, GOAL = (60, 80), (330, 210)  # [pixel] of drawing()
MEASURE = """
import json, phri_sim, sys
def high_water():
    with open("/proc/self/status") as status:
        return next(int(line.split()[1]) for line in status if line.startswith("VmHWM")) / 1024
before, text = high_water(), ""
try:
    phri_sim.load_scene(sys.argv[1])
except phri_sim.PictureError as error:
    text = str(error)
print(json.dumps([high_water() - before, text]))
"""


def drawing(mode="RGB"):
    """400 x 300 pixels: a wall of 12 pixels with an opening below, a green dot on its left, a red one on its right."""
    picture = Image.new(mode, (400, 300), "white")
    draw = ImageDraw.Draw(picture)
    draw.rectangle([190, 0, 201, 200], fill="black")
    for (x, y), color in ((START, (0, 170, 60)), (GOAL, (210, 30, 30))):
        draw.ellipse([x - 12, y - 12, x + 12, y + 12], fill=color)
    return picture


def place(x, y, resolution=0.3 / 400):
    """Metres of the centre of the pixel (x, y) of drawing()."""
    return np.array([(x + 0.5 - 200) * resolution, (150 - y - 0.5) * resolution])


def encoded(picture, kind, **options):
    out = io.BytesIO()
    picture.save(out, kind, **options)
    return out.getvalue()


def chunk(name, data):
    return struct.pack(">I", len(data)) + name + data + struct.pack(">I", zlib.crc32(name + data))


def png(width, height, *chunks):
    header = chunk(b"IHDR", struct.pack(">IIBBBBB", width, height, 1, 0, 0, 0, 0))
    return b"\x89PNG\r\n\x1a\n" + header + b"".join(chunks) + chunk(b"IEND", b"")


def svg(body, size=300):
    return b'<svg xmlns="http://www.w3.org/2000/svg" width="%d" height="%d">' % (size, size) + body + b"</svg>"


def refusal(path):
    with pytest.raises(phri_sim.PictureError) as error:
        phri_sim.load_scene(str(path))
    assert str(path) in str(error.value)
    return str(error.value)


@pytest.fixture
def write(tmp_path):
    def written(name, data):
        path = tmp_path / name
        path.write_bytes(data)
        return path
    return written


def test_grey_pictures_come_out_as_they_went_in():
    """The walls of the study depend on it, to the bit."""
    expected = np.asarray(Image.open(SHARE / "config" / "scenes" / "maze.png").convert("L"))
    assert np.array_equal(phri_sim.load_scene("maze").image, expected)


def test_distances_lie_as_the_picture_does():
    scene = phri_sim.load_scene("maze")
    height, width = scene.distances.shape
    for row, column in ((10, 20), (300, 100), (590, 300)):
        x = scene.origin + scene.resolution * np.array([column + 0.5, height - row - 0.5])
        assert scene.distance(x) == pytest.approx(scene.distances[row, column], abs=1e-9)
    assert ((scene.distances < 0) == (scene.image < 89)).all()  # darkness above 0.65


@pytest.mark.parametrize("options", [
    {"kind": "JPEG", "quality": 75},
    {"kind": "JPEG", "quality": 75, "progressive": True, "subsampling": 2},
    {"kind": "JPEG", "quality": 40},
    {"kind": "PNG"},
], ids=["jpeg75", "progressive", "jpeg40", "png"])
def test_dots_survive_the_format(write, options):
    """JPEG blurs colour over 16 pixels and puts ripples around edges: the dots stay where they are, and free."""
    picture = drawing()
    scene = phri_sim.load_scene(str(write("drawing.png" if options["kind"] == "PNG" else "drawing.jpg",
                                          encoded(picture, options.pop("kind"), **options))))
    assert scene.start == pytest.approx(place(*START), abs=0.25 * scene.resolution)
    assert scene.goal == pytest.approx(place(*GOAL), abs=0.25 * scene.resolution)
    # the nearest wall is the picture's left edge, or its right one: no wall pixel in or by a dot
    assert scene.distance(scene.start) == pytest.approx(60.5 * scene.resolution, abs=scene.resolution)
    assert scene.distance(scene.goal) == pytest.approx((400 - 330.5) * scene.resolution, abs=scene.resolution)
    assert len(scene.route()) > 1.1e3 * np.hypot(*(scene.goal - scene.start)), "not around the wall"


def test_a_turned_photograph_is_turned_back(write):
    exif = Image.Exif()
    exif[0x0112] = 6  # the camera was held 90 degrees to the left
    turned = drawing().transpose(Image.Transpose.ROTATE_90)
    scene = phri_sim.load_scene(str(write("turned.jpg", encoded(turned, "JPEG", quality=90, exif=exif))))
    assert scene.image.shape == (300, 400)
    assert scene.start == pytest.approx(place(*START), abs=0.5 * scene.resolution)


def test_transparent_is_white(write):
    picture = drawing("RGBA")
    pixels = np.array(picture)
    pixels[(pixels[..., :3] == 255).all(axis=-1)] = (0, 0, 0, 0)  # black, and invisible
    pixels[0, 0] = (0, 0, 0, 128)
    scene = phri_sim.load_scene(str(write("glass.png", encoded(Image.fromarray(pixels), "PNG"))))
    assert scene.image[299, 0] == 255 and scene.image[0, 195] == 0 and scene.image[0, 0] == 127


def test_svg_opens_no_other_file(write):
    """What it draws from the disk stays out: a wall in another file is none."""
    wall = write("wall.png", encoded(Image.new("L", (300, 300), 0), "PNG"))
    dots = b'<circle cx="50" cy="50" r="9" fill="#00c000"/><circle cx="250" cy="250" r="9" fill="red"/>'
    for link in (wall.as_uri(), str(wall), wall.name):
        scene = phri_sim.load_scene(str(write("link.svg", svg(
            b'<image width="300" height="300" href="%s"/>' % link.encode() + dots))))
        assert scene.image.min() > 200, "a wall"  # the rims of the dots are a little grey


@pytest.mark.parametrize("name, package", [
    ("a.svg", "librsvg2-common"), ("a.pgm", "libgdk-pixbuf-2.0-0")])
def test_a_missing_module_names_its_package(write, name, package):
    path = write(name, svg(b"") if name == "a.svg" else b"P5 4 4 255\n" + bytes(16))
    run = subprocess.run([sys.executable, "-c", MEASURE, path], capture_output=True, text=True, check=True,
                         env={**os.environ, "GDK_PIXBUF_MODULE_FILE": os.devnull})
    assert f"install the package {package}" in run.stdout


def decoder():
    """The program that decodes, beside the library."""
    with open("/proc/self/maps") as maps:
        library = next(line.split()[-1] for line in maps if line.rstrip().endswith("libphri_sim.so"))
    return Path(library).parent / "phri_sim" / "decode_picture"


def decoder_memory(path):
    """High water of the decoder [MB]: it has decoded when it writes, and waits because nobody reads."""
    with subprocess.Popen([decoder(), path], stdout=subprocess.PIPE) as process:
        process.stdout.read(1)
        status = Path(f"/proc/{process.pid}/status").read_text()
        process.kill()
    water = [line for line in status.splitlines() if line.startswith("VmHWM")]
    return int(water[0].split()[1]) / 1024 if water else 0.0  # none: it is through already, with a small picture


def load(path):
    """(memory of this side [MB], error) of loading a picture in a new process."""
    run = subprocess.run([sys.executable, "-c", MEASURE, path], capture_output=True, text=True, check=True)
    return json.loads(run.stdout)


@pytest.mark.skipif(os.environ.get("PHRI_PROFILE") == "asan", reason="the sanitizers take memory of their own")
@pytest.mark.parametrize("kind, options", [
    ("PNG", {"compress_level": 1}),
    ("JPEG", {"quality": 90, "progressive": True, "subsampling": 0}),
], ids=["png", "progressive jpeg"])
def test_the_largest_picture_stays_within_the_memory(write, record_property, kind, options):
    picture = drawing().resize((LARGEST, LARGEST), Image.Resampling.NEAREST)
    path = write("large.png" if kind == "PNG" else "large.jpg", encoded(picture, kind, **options))
    here, text = load(path)
    there = decoder_memory(path)
    record_property("memory", here)
    record_property("decoder_memory", there)
    assert text == ""
    assert LARGEST**2 * 3 / 2**20 < there < 200, "not measured, or more than its limit"
    reading = LARGEST**2 * 3 / 2**20  # what this side holds while the decoder lives: grey, green, red
    assert here < MEMORY and there + reading < MEMORY


BOMB = png(30000, 30000, chunk(b"IDAT", zlib.compress(bytes(30000 * 3751), 9)))
HURTING = {
    "bomb.png": (BOMB, "30000 x 30000 pixels: expected 2 x 2 to 4096 x 4096"),
    "header.png": (png(30000, 30000, chunk(b"IDAT", zlib.compress(b""))), "30000 x 30000 pixels: expected 2 x 2"),
    "text.png": (png(8, 8, chunk(b"zTXt", b"x\0\0" + zlib.compress(bytes(100_000_000), 9)) * 4), "damaged PNG file"),
    "long.pgm": (b"P5 4097 2 255\n" + bytes(8194), "4097 x 2 pixels: expected 2 x 2 to 4096 x 4096"),
    "nested.svg": (svg(b'<g opacity="0.9">' * 5000 + b"</g>" * 5000), "picture"),
    "inside.svg": (svg(b'<image width="9" height="9" href="data:image/png;base64,' + base64.b64encode(BOMB)
                       + b'"/>'), "has no green dot"),
    "entities.svg": (b'<!DOCTYPE svg [<!ENTITY a "aaaaaaaaaa">' + b"".join(
        b'<!ENTITY %c "%s">' % (98 + i, b"&%c;" % (97 + i) * 20) for i in range(10)) + b"]>" + svg(b"<text>&k;</text>"),
        "damaged SVG file"),
    "filter.svg": (svg(b'<filter id="f">' + b'<feTurbulence baseFrequency="0.05" numOctaves="2000"/>' * 50
                       + b'</filter><rect width="300" height="300" filter="url(#f)"/>'),
                   "takes longer to decode than 1.5 s of processor time"),
}


@pytest.mark.skipif(os.environ.get("PHRI_PROFILE") == "asan", reason="the sanitizers take memory of their own")
@pytest.mark.parametrize("name", HURTING)
def test_pictures_made_to_hurt_do_not(write, record_property, name):
    data, expected = HURTING[name]
    path = write(name, data)
    here, text = load(path)
    record_property("memory", here)
    assert str(path) in text and expected in text
    assert here < 32, "this side holds what only the decoder may"


def test_the_decoder_cannot_take_more_memory_than_its_limit(write):
    """A blur at 4096 x 4096 pixels wants a dozen surfaces of 64 MB."""
    body = b'<filter id="f">' + b'<feGaussianBlur stdDeviation="9"/>' * 12 + b"</filter>"
    path = write("blur.svg", svg(body + b'<rect width="300" height="300" filter="url(#f)"/>'))
    scene = write("blur.yaml", b"image: blur.svg\nsize: [0.4096, 0.4096]\nresolution: 0.0001\n")
    with pytest.raises(phri_sim.PictureError) as error:
        phri_sim.load_scene(str(scene))
    assert str(path) in str(error.value) and "has no" not in str(error.value)


def test_errors_are_value_errors_of_two_kinds(write):
    """Bad data and a bad configuration have exit codes of their own."""
    import phri_core
    assert issubclass(phri_sim.PictureError, ValueError) and issubclass(phri_core.ParameterError, ValueError)
    assert not issubclass(phri_sim.PictureError, phri_core.ParameterError)
    assert "is empty (0 bytes)" in refusal(write("empty.png", b""))
    assert "first bytes are of no picture" in refusal(write("noise.jpg", np.random.default_rng(1).bytes(5000)))
    path = write("scene.yaml", b"image: a.png\nsize: [0.3, -1]\n")
    with pytest.raises(phri_core.ParameterError, match="size = -1 m: expected a number from 0.001 to 1000"):
        phri_sim.load_scene(str(path))


def test_a_person_carries_the_object_through_a_photograph():
    table = phri_sim.run_trial("picture_demo", controller="none", participant=0, trial=1)
    assert table.attrs["completed"] and "turning_point_x" not in table.attrs
    scene = phri_sim.load_scene("handdrawn.jpg")
    last = table[["x", "y"]].iloc[-1].to_numpy()  # a tick before the end
    assert np.hypot(*(last - scene.goal)) < scene.goal_radius + 5e-4


if __name__ == "__main__":
    sys.exit(pytest.main([__file__]))
