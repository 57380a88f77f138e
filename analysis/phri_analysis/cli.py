"""Command line: `phri-analysis report|check|recover|lateness BAGS...`, `phri-analysis simulate EXPERIMENT`,
`phri-analysis learn DATA...`, `phri-analysis study NAME`, `phri-analysis figures [ID...]`,
`phri-analysis calibrate-ft RECORDING` and `phri-analysis measure-delay RECORDING`.

Errors are one line on stderr. Exit codes (sysexits.h): 0 done, 64 usage, 65 bad data, 66 missing input, 70 internal
error, 74 cannot write, 78 bad configuration.
"""

import sys
import traceback
from pathlib import Path

import click

from . import __version__
from .errors import AnalysisError, BagError, DataError, UsageError

CONTEXT = {"help_option_names": ["-h", "--help"], "max_content_width": 110}


@click.group(context_settings=CONTEXT)
@click.version_option(__version__)
def cli():
    """Measures, pictures and reports of physical human-robot interaction trials."""


@cli.command()
@click.argument("bags", nargs=-1, required=True, metavar="BAGS_OR_DIR...", type=click.Path(path_type=Path))
@click.option(
    "--out",
    type=click.Path(path_type=Path, file_okay=False),
    default=None,
    metavar="DIR",
    help="Folder for report.html, table.csv and figures/. [default: the folder given, else the first bag's]",
)
@click.option("--title", default="", help="Heading of the report.")
@click.option(
    "--skip-bad", is_flag=True, help="Leave unreadable bags out, and say so in the report, instead of stopping."
)
@click.option("--jobs", type=int, default=0, metavar="J", help="Bags read at once. [default: all cores]")
def report(bags, out, title, skip_bad, jobs):
    """Reads recorded trials, prints their measures and writes a self-contained report."""
    from . import recorded, style
    from .bags import find_bags

    if jobs < 0:
        raise UsageError(f"jobs is {jobs}, expected 1 or more, or 0 for all cores")
    files = find_bags(bags)
    kept = recorded.read_study(files, jobs, skip_bad, progress=sys.stderr.isatty())
    for _, error in kept.skipped:
        click.echo(f"left out: {error}", err=True)
    notes = []
    for controller, values in recorded.ratings(files):
        whose = "changed trials" if controller == "changed" else style.label(controller)
        notes.append((f"Ratings, 1 hindered to 6 helped, {whose}", ", ".join(map(str, values))))
    _finish(kept, out or (bags[0] if bags[0].is_dir() else files[0].parent), title, notes)


@cli.command()
@click.argument("experiment")
@click.option(
    "--participants", type=int, default=None, metavar="N", help="Number of participants. [default: experiment]"
)
@click.option("--trials", type=int, default=None, metavar="N", help="Trials per controller. [default: experiment]")
@click.option(
    "--controllers", default="", metavar="A,B", help="Only these controllers. [default: all of the experiment]"
)
@click.option("--seed", type=int, default=None, metavar="S", help="Seed of everything random. [default: experiment]")
@click.option(
    "--set", "settings", multiple=True, metavar="KEY=VALUE", help="Another parameter; repeatable."
)
@click.option("--jobs", type=int, default=1, show_default=True, metavar="J", help="Processes on this machine.")
@click.option(
    "--scheduler", default="", metavar="ADDRESS", help="Dask scheduler, to use many machines (tcp://host:8786)."
)
@click.option(
    "--out",
    type=click.Path(path_type=Path, file_okay=False),
    default=None,
    metavar="DIR",
    help="Folder for report.html, table.csv and figures/. [default: results/studies/EXPERIMENT]",
)
def simulate(experiment, participants, trials, controllers, seed, settings, jobs, scheduler, out):
    """Runs EXPERIMENT (a name or a YAML file) in lockstep without ROS, faster than real time, and reports on it."""
    from . import simulate as runner

    names = tuple(name.strip() for name in controllers.split(",") if name.strip())
    changed = tuple(runner.setting(text) for text in settings)
    request = runner.Request(experiment, participants, trials, names, seed, changed)
    kept = runner.simulate(request, jobs, scheduler, progress=sys.stderr.isatty())
    shown = [
        (name, value)
        for name, value in (
            ("participants", participants),
            ("trials", trials),
            ("seed", seed),
            ("controllers", ",".join(names)),
        )
        if value not in (None, "")
    ]
    options = [f"--{name} {value}" for name, value in shown] + [f"--set {text}" for text in settings]
    command = " ".join(["phri-analysis simulate", experiment, *options])
    notes = [("Command", command), ("Revision", runner.git_revision() or "not a git checkout")]
    _finish(kept, out or Path("results") / "studies" / Path(experiment).stem, "", notes)
    simulated, wall = (sum(column) for column in zip(*kept.speed))
    click.echo(
        f"lockstep: {simulated:.0f} s simulated in {wall:.1f} s of one core, {simulated / wall:.0f} times real time "
        "(person, device, scene, loop, predictions, plans and learning)"
    )


@cli.command()
@click.argument("bags", nargs=-1, required=True, metavar="BAGS_OR_DIR...", type=click.Path(path_type=Path))
def check(bags):
    """Verifies recordings: structure, counts, and the CRC-32 of every payload where the bag holds digests."""
    from .bag_check import inspect
    from .bags import find_bags

    damaged = []
    for path in find_bags(bags):
        found = inspect(path)
        click.echo(f"{'DAMAGED' if found.problems else 'ok'} {path}: {found.summary()}")
        for problem in found.problems:
            click.echo(f"  {problem}")
        if found.problems:
            damaged.append(f"{path}: {found.headline()}")
    if damaged:
        more = f"; {len(damaged)} bags are damaged" if len(damaged) > 1 else ""
        raise BagError(damaged[0] + more)


@cli.command()
@click.argument("bags", nargs=-1, required=True, metavar="BAG...", type=click.Path(path_type=Path))
def recover(bags):
    """Saves what is intact of damaged or cut-off recordings (.bag, .bag.active, .bag.aborted) into NAME.recovered.bag
    beside them; never overwrites."""
    from .bag_check import recover as save

    for path in bags:
        target, found = save(path)
        first, last = found.span
        click.echo(f"{target}: {len(found.messages)} messages, {(last - first) * 1e-9:.3f} s saved")
        click.echo(f"  of {path}: {found.summary()}")
        for problem in found.problems:
            click.echo(f"  {problem}")


@cli.command()
@click.argument("bags", nargs=-1, required=True, metavar="BAGS_OR_DIR...", type=click.Path(path_type=Path))
@click.option(
    "--out",
    type=click.Path(path_type=Path, dir_okay=False),
    default=None,
    metavar="FILE",
    help="Picture. [default: lateness.png in the folder given, else beside the first bag]",
)
def lateness(bags, out):
    """Prints and draws how late the ticks of real-time trials came."""
    from . import lateness as late
    from .bags import find_bags, read_trial

    files = find_bags(bags)
    tables = []
    for path in files:
        table = read_trial(path)
        try:
            late.of_trial(table)
        except DataError as error:
            raise DataError(f"{path}: {error}") from None
        tables.append(table)
    result = late.summary(tables)
    click.echo(f"{result.table()}\n{result.line()}")
    folder = bags[0] if bags[0].is_dir() else files[0].parent
    click.echo(f"picture: {late.write_figure(result, out or folder / 'lateness.png')}")


@cli.command()
@click.argument("name")
@click.option("--people", type=int, default=None, metavar="N", help="Simulated participants. [default: study]")
@click.option("--jobs", type=int, default=2, show_default=True, metavar="J", help="Processes on this machine.")
@click.option(
    "--out",
    type=click.Path(path_type=Path, file_okay=False),
    default=None,
    metavar="DIR",
    help="Folder for table.csv, report.html and session.yaml. [default: results/studies/NAME]",
)
@click.option("--data", type=click.Path(path_type=Path), default=None, metavar="PATH",
              help="Data of your own, for the studies of recorded motions.")  # fmt: skip
def study(name, people, jobs, out, data):
    """Runs the evaluation NAME (a module of analysis/studies) on simulated participants, or on recorded motions, and
    reports on it."""
    import studies

    folder = out or Path("results") / "studies" / name
    options = studies.Options(folder, jobs, people, sys.stderr.isatty(), data)
    click.echo("\n".join(studies.run(name, options)))


@cli.command()
@click.argument("data", nargs=-1, required=True, metavar="DATA...", type=click.Path(path_type=Path))
@click.option("--pose", default="", metavar="TOPIC", help="Pose topic of the bags. [default: the only one]")
@click.option(
    "--wrench", default="", metavar="TOPIC", help="The same for the wrench; none: learn from positions only."
)
@click.option("--segment", is_flag=True, help="Cut long recordings into segments first.")
@click.option("--cutoff", type=float, default=0.6, show_default=True, metavar="K",
              help="Segments of a primitive are nearer than K times the mean distance of all.")  # fmt: skip
@click.option("--jobs", type=int, default=1, show_default=True, metavar="J", help="Processes on this machine.")
@click.option(
    "--out",
    type=click.Path(path_type=Path, file_okay=False),
    default=None,
    metavar="DIR",
    help="Folder for library.json, tables and pictures. [default: results/learn/NAME]",
)
def learn(data, pose, wrench, segment, cutoff, jobs, out):
    """Learns movement primitives from demonstrations: bags, .csv, .npz, a LASA folder; says how well they predict."""
    from . import learn as learning

    folder = out or Path("results") / "learn" / data[0].stem
    click.echo("\n".join(learning.run(data, folder, pose, wrench, segment, cutoff, jobs)))


@cli.command()
@click.argument("ids", nargs=-1, metavar="[ID...]")
@click.option(
    "--rollouts", type=int, default=10000, show_default=True, metavar="N", help="Simulated runs of every policy."
)
@click.option("--jobs", type=int, default=1, show_default=True, metavar="J", help="Processes on this machine.")
@click.option(
    "--out",
    type=click.Path(path_type=Path, file_okay=False),
    default=None,
    metavar="DIR",
    help="Folder for a folder per figure and index.html. [default: results/figures]",
)
def figures(ids, rollouts, jobs, out):
    """Makes the figures of the thesis anew, for instance 4.5, all if none is named: data.csv, figure.png, setting.yaml
    and further tables each, and one page over all; prints which statements of the thesis the numbers confirm."""
    import figures as pages

    pages.run(ids, pages.Options(rollouts, jobs), out or Path("results") / "figures", click.echo)


@cli.command("calibrate-ft")
@click.argument("recording", type=click.Path(path_type=Path))
@click.option("--pose", default="", metavar="TOPIC", help="Pose topic of a bag. [default: the only one]")
@click.option("--wrench", default="", metavar="TOPIC", help="Raw wrench topic of a bag. [default: the only one]")
@click.option("--max-residual", type=click.FloatRange(min=0, min_open=True), default=0.5, show_default=True,
              metavar="N", help="Largest rms residual [N] (a tenth of it in Nm).")  # fmt: skip
@click.option("--out", type=click.Path(path_type=Path, dir_okay=False), default=None, metavar="FILE",
              help="Writes the result as YAML, too.")  # fmt: skip
def calibrate_ft(recording, pose, wrench, max_residual, out):
    """Identifies payload and bias of a force/torque sensor from RECORDING (.bag, .csv, .npz) of 8 poses at rest or
    more: mass, centre of mass, bias, residual."""
    from . import lab_tools

    found = lab_tools.calibrate(recording, pose, wrench, max_residual)
    click.echo("\n".join(found.lines()) + f"\n\n{found.yaml()}", nl=False)
    if out:
        out.write_text(found.yaml(), encoding="utf-8")
        click.echo(f"\nwritten: {out}")


@cli.command("measure-delay")
@click.argument("recording", type=click.Path(path_type=Path))
@click.option(
    "--command", default="command", show_default=True, metavar="NAME", help="Column, or TOPIC:FIELD of a bag."
)
@click.option("--response", default="response", show_default=True, metavar="NAME", help="The same of the response.")
@click.option("--max-delay", type=float, default=0.2, show_default=True, metavar="S", help="Longest delay [s].")
@click.option("--admittance", type=float, nargs=2, default=None, metavar="M D", help="Your own, beside the thesis'.")
def measure_delay(recording, command, response, max_delay, admittance):
    """Estimates the delay of a loop from RECORDING (.bag, .csv, .npz) of its command and response, and prints the
    stiffness of a contact that admittances stay stable on with it."""
    from . import lab_tools

    click.echo("\n".join(lab_tools.measure_delay(recording, command, response, max_delay, admittance).lines()))


def _finish(kept, out, title, notes=()):
    from . import report as writer

    path = writer.write_report(kept, out, title, notes)
    click.echo(writer.terminal_table(kept.table()))
    click.echo(f"\ntable:  {path.parent / 'table.csv'}\nreport: {path}")


def main(arguments=None):
    """Entry point of the console script."""
    try:
        sys.exit(cli.main(arguments, prog_name="phri-analysis", standalone_mode=False) or 0)
    except click.exceptions.Exit as done:
        sys.exit(done.exit_code)
    except click.Abort:
        _fail("interrupted", 130)
    except click.ClickException as error:
        # NoArgsIsHelp and friends carry a whole help text; keep its first line only.
        _fail(error.format_message().splitlines()[0], UsageError.exit_code)
    except AnalysisError as error:
        _fail(str(error), error.exit_code)
    except BrokenPipeError:
        sys.exit(0)
    except OSError as error:
        _fail(str(error), 74)
    except Exception as error:  # the last resort: a defect of ours, said in one line
        frame = traceback.extract_tb(error.__traceback__)[-1]
        _fail(
            f"internal error at {Path(frame.filename).name}:{frame.lineno}, {type(error).__name__}: {error}",
            AnalysisError.exit_code,
        )


def _fail(text, code):
    click.echo(f"phri-analysis: {' '.join(text.split())}", err=True)
    sys.exit(code)
