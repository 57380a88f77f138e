"""What can go wrong, by the exit code (sysexits.h) that the command line gives it."""


class AnalysisError(Exception):
    """An error whose text alone tells a user what is wrong and what was expected. One line."""

    exit_code = 70


class UsageError(AnalysisError):
    """The request makes no sense: an unknown controller, a negative count."""

    exit_code = 64


class DataError(AnalysisError):
    """A trial table that breaks its contract: a missing column, a value that is not finite, time that does not rise."""

    exit_code = 65


class BagError(DataError):
    """A bag that cannot be read as a trial; the text names file, topic and what was expected there."""


class MissingInputError(AnalysisError):
    """A file, an experiment or a module that is not there."""

    exit_code = 66


class ConfigurationError(AnalysisError):
    """A configuration with wrong keys or values; all of them are named."""

    exit_code = 78


class OutputError(AnalysisError):
    """The result cannot be written."""

    exit_code = 74
