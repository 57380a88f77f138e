import sys
from pathlib import Path

import pytest

HERE = Path(__file__).resolve().parent
sys.path[:0] = [str(HERE.parent), str(HERE)]


class Core:
    """The two functions of module phri_core that the analysis asks for."""

    @staticmethod
    def limit_names():
        return ["wrench", "force", "slew", "power"]

    @staticmethod
    def assistance_limits():
        return ["force", "slew", "power"]


@pytest.fixture
def known_limits(monkeypatch):
    """Limit names that do not depend on whether the C++ library is built."""
    from phri_analysis import trial_table

    monkeypatch.setattr(trial_table, "_core", lambda: Core)
    return Core.limit_names()


@pytest.fixture
def unknown_limits(monkeypatch):
    from phri_analysis import trial_table

    monkeypatch.setattr(trial_table, "_core", lambda: None)
