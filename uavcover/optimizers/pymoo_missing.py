"""The one line that everything which needs pymoo says when it is not there."""

from uavcover.errors import OptimizerError


def pymoo_missing(what: str, reason: ImportError) -> OptimizerError:
    """The error to raise when ``what`` cannot import pymoo.

    >>> print(pymoo_missing("NSGA2", ImportError("No module named 'pymoo'")))
    NSGA2 needs pymoo (No module named 'pymoo'): install the extra, pip install 'uavcover[bench]'
    """
    return OptimizerError(f"{what} needs pymoo ({reason}): install the extra, pip install 'uavcover[bench]'")
