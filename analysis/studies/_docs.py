"""Keeps docs/participants.md true: writes the tables of finished studies between their markers, and the picture.

    python3 -m studies._docs results/studies [docs/participants.md]

A block reads `<!-- NAME: generated -->` ... `<!-- NAME: end -->`; the names are those of `blocks`.
"""

import re
import sys
from pathlib import Path

from phri_analysis import study
from phri_analysis.errors import AnalysisError, DataError, MissingInputError

from . import _page, _pictures, calibration, validation

DOCUMENT = Path(__file__).resolve().parents[2] / "docs" / "participants.md"


def blocks(measures, sensitivity, properties) -> dict:
    """Name of a block -> its Markdown, from the tables of the studies."""
    return {
        "calibration": _page.markdown(*calibration.summary_rows(calibration.summary(measures))),
        "subtasks": _page.markdown(*calibration.subtask_rows(measures)),
        "sensitivity": _page.markdown(*calibration.sensitivity_rows(sensitivity, only_significant=True)),
        "validation": _page.markdown(*validation.rows_of_text(properties)),
    }


def block(text: str, name: str) -> str:
    """What stands between the markers of a block; DataError where there are none."""
    found = re.search(f"<!-- {name}: generated -->\n(.*?)\n<!-- {name}: end -->", text, re.S)
    if not found:
        raise DataError(f"block {name}: no markers <!-- {name}: generated --> and <!-- {name}: end -->")
    return found.group(1)


def replaced(text: str, name: str, content: str) -> str:
    begin = f"<!-- {name}: generated -->\n"
    return text.replace(f"{begin}{block(text, name)}\n", f"{begin}{content}\n")


def update(results, document=DOCUMENT) -> None:
    """From the folder that holds calibration/ and validation/."""
    results, document = Path(results), Path(document)
    sensitivity = study.read_table(results / "calibration" / "sensitivity.csv")
    measures = study.read_table(results / "calibration" / "table.csv")
    measures = measures.set_index(["subtask", "seed", "participant"]).sort_index()
    properties = validation.read_table(results / "validation" / "table.csv")
    if not document.is_file():
        raise MissingInputError(f"{document}: no such file")
    text = document.read_text(encoding="utf-8")
    for name, content in blocks(measures, sensitivity, properties).items():
        text = replaced(text, name, content)
    figure = _pictures.calibration_figure(measures.loc["whole"], sensitivity, calibration.THESIS, calibration.BAND)
    (document.parent / "figures").mkdir(exist_ok=True)
    (document.parent / "figures" / "calibration.png").write_bytes(_page.png(figure, dpi=120))
    document.write_text(text, encoding="utf-8")


if __name__ == "__main__":
    if len(sys.argv) not in (2, 3):
        print("usage: python3 -m studies._docs RESULTS [DOCUMENT]", file=sys.stderr)
        sys.exit(64)
    try:
        update(*sys.argv[1:])
    except AnalysisError as error:
        print(f"studies._docs: {error}", file=sys.stderr)
        sys.exit(error.exit_code)
