"""docker/setup.sh with a fake dpkg and apt: what is missing is named, nothing is done twice, and no failure is taken
for success. (That it installs on a bare Debian 12 is what CI shows each time.)"""

import os
import pathlib
import shutil
import subprocess

import pytest

ROOT = pathlib.Path(__file__).resolve().parent.parent
BOOKWORM = 'ID=debian\nVERSION_CODENAME=bookworm\nPRETTY_NAME="Debian GNU/Linux 12 (bookworm)"\n'
UBUNTU = 'ID=ubuntu\nVERSION_CODENAME=noble\nPRETTY_NAME="Ubuntu 24.04.1 LTS"\n'

# the fakes keep their state in files: installed (one name per line), offered, log
FAKES = {
    "dpkg-query": 'while read -r name; do echo "ii  $name"; done <"$STATE/installed"; exit 1',
    "apt-cache": 'shift; while read -r name; do printf "%s:\\n  Candidate: 1.0\\n" "$name"; done <"$STATE/offered"',
    "apt-get": '''echo "apt-get $*" >>"$STATE/log"
case " $* " in
  *" update "*) exit "$(cat "$STATE/update")" ;;
  *" install "*)
    echo "0 upgraded, 2 newly installed, 0 to remove and 0 not upgraded."
    cat "$STATE/will_install" >>"$STATE/installed"
    while read -r name; do echo "Setting up $name (1.0) ..."; done <"$STATE/will_install"
    exit "$(cat "$STATE/install")" ;;
esac''',
    "id": 'cat "$STATE/uid"',
    "sudo": 'echo "sudo $*" >>"$STATE/log"; exec "$@"',
}


class Machine:
    """A checkout with two packages listed, on a machine whose package tools are fakes."""

    def __init__(self, folder):
        self.state, self.bin = folder / "state", folder / "bin"
        for path in (self.state, self.bin, folder / "docker"):
            path.mkdir()
        shutil.copy(ROOT / "docker" / "setup.sh", folder / "docker")
        (folder / "docker" / "packages.txt").write_text("# comment\nalpha  # why\n\n# more\nbeta\n")
        for name, body in FAKES.items():
            (self.bin / name).write_text(f"#!/bin/bash\n{body}\n")
            (self.bin / name).chmod(0o755)
        self.script = folder / "docker" / "setup.sh"
        self.set(installed="", offered="alpha\nbeta\n", will_install="alpha\nbeta\n", update="0", install="0", uid="0",
                 os_release=BOOKWORM, log="")

    def set(self, **values):
        for name, text in values.items():
            (self.state / name).write_text(text)

    def run(self):
        environment = dict(os.environ, PATH=f"{self.bin}:/usr/bin:/bin", STATE=str(self.state),
                           PHRI_OS_RELEASE=str(self.state / "os_release"))
        return subprocess.run(["bash", self.script], env=environment, capture_output=True, text=True)

    def log(self):
        return (self.state / "log").read_text()


@pytest.fixture
def machine(tmp_path):
    return Machine(tmp_path)


def test_installs_what_is_missing_then_has_nothing_to_do(machine):
    machine.set(installed="beta\n", will_install="alpha\n")
    first = machine.run()
    assert first.returncode == 0, first.stderr
    assert "1 of 2 packages are missing: alpha" in first.stdout
    install = machine.log().splitlines()[-1]
    assert install.endswith("install -y --no-install-recommends alpha") and "sudo" not in machine.log()
    machine.set(log="")
    second = machine.run()
    assert (second.returncode, second.stdout) == (0, "setup: all 2 packages are installed\n")
    assert machine.log() == ""


def test_progress_is_shown(machine):
    assert "set up 2 of 2 packages" in machine.run().stdout


def test_uses_sudo_when_not_root(machine):
    machine.set(uid="1000")
    assert machine.run().returncode == 0
    assert machine.log().count("sudo ") == 2  # update, install


def test_without_root_and_sudo_names_what_is_missing(machine):
    machine.set(uid="1000")
    (machine.bin / "sudo").unlink()
    # a PATH without the system's own sudo: links to what the script needs
    for name in ("bash", "sed", "tr", "sort", "comm", "mktemp", "rm", "grep", "dirname", "cat"):
        (machine.bin / name).symlink_to(shutil.which(name, path="/usr/bin:/bin"))
    done = subprocess.run(["/bin/bash", machine.script], capture_output=True, text=True,
                          env={"PATH": str(machine.bin), "STATE": str(machine.state),
                               "PHRI_OS_RELEASE": str(machine.state / "os_release")})
    assert done.returncode == 1
    assert "run as root, or install sudo" in done.stderr and "missing: alpha beta" in done.stderr


def test_unavailable_packages_are_named_before_anything_is_installed(machine):
    machine.set(offered="beta\n")
    done = machine.run()
    assert done.returncode == 1 and "no package source offers: alpha" in done.stderr
    assert "install" not in machine.log()


@pytest.mark.parametrize("state, message", [
    ({"update": "100"}, "apt-get update failed"),
    ({"install": "100", "will_install": "alpha\n"}, "apt-get install failed; not installed: beta"),
    ({"will_install": "alpha\n"}, "these are not installed: beta"),
])
def test_failures_of_apt(machine, state, message):
    machine.set(**state)
    done = machine.run()
    assert done.returncode == 1 and message in done.stderr


def test_broken_sources_are_errors(machine):
    machine.run()
    assert "APT::Update::Error-Mode=any" in machine.log().splitlines()[0]


@pytest.mark.parametrize("text, name", [(UBUNTU, "Ubuntu 24.04.1 LTS"), ("", "an unknown system"),
                                        (BOOKWORM.replace("bookworm", "trixie").replace("12", "13"),
                                         "Debian GNU/Linux 13 (trixie)")])
def test_another_system_is_told_the_docker_commands(machine, text, name):
    machine.set(os_release=text)
    done = machine.run()
    assert done.returncode == 3 and f"this is {name}." in done.stderr
    assert "docker build -t phri -f docker/Dockerfile ." in done.stderr and "docker run" in done.stderr
    assert machine.log() == ""


def test_make_stops_on_another_system(tmp_path):
    (tmp_path / "os_release").write_text(UBUNTU)
    environment = dict(os.environ, PHRI_OS_RELEASE=str(tmp_path / "os_release"))
    for target in ("demo", "test", "check"):
        done = subprocess.run(["make", "-C", ROOT, target], env=environment, capture_output=True, text=True)
        assert done.returncode != 0 and "docker build" in done.stderr
        assert "catkin" not in done.stdout  # no build was begun


def test_package_list_is_well_formed():
    lines = (ROOT / "docker" / "packages.txt").read_text().splitlines()
    names = [name for line in lines for name in line.split("#")[0].split()]
    assert len(names) == len(set(names))
    assert all(name == name.lower() and not name.endswith(",") for name in names)
