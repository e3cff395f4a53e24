"""What an oracle of a plugin returns: results hold it, or the oracle is named."""

import json
import math
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from wil_campaign.foundation.files.document_writer import to_json
from wil_campaign.safety.evaluation.judge import Judge
from wil_campaign.safety.model.oracle_results import Flag, OracleResult
from wil_campaign.safety.model.samples import PoseSample
from wil_campaign.safety.oracles.oracle import Oracle, OracleTerms
from wil_campaign.worlds.frames import Pose

GOOD = OracleResult("own", "twin", True, "PASS", 1.0, 5.0, "m/s", 4.0, 1.0)


class Says(Oracle):
    """Returns what it is given, as the oracle of a plugin may return anything."""

    def __init__(self, result: Any = GOOD, flags: Any = ()) -> None:
        super().__init__(OracleTerms(name="own", vehicle="twin", required=True))
        self._result, self._flags = result, flags

    def on_pose(self, sample: PoseSample) -> Any:
        del sample
        return self._flags

    def result(self, t_s: float) -> Any:
        del t_s
        return self._result


def test_numbers_of_numpy_are_python_s() -> None:
    numbers: Any = {
        "actual": np.float32(1.5),
        "margin": np.int64(3),
        "limit": (np.float16(2), None),
    }
    (found,) = Judge([Says(replace(GOOD, **numbers))]).results(2.0)
    written = json.loads(to_json(found))
    assert (written["actual"], written["margin"], written["limit"]) == (1.5, 3.0, [2.0, None])


def test_a_value_that_is_not_finite_is_invalid() -> None:
    (found,) = Judge([Says(replace(GOOD, margin=math.inf))]).results(2.0)
    assert (found.verdict, found.required) == ("INVALID", True)


@pytest.mark.parametrize(
    ("result", "said"),
    [
        (None, "its result is a NoneType"),
        (replace(GOOD, required=False, verdict="FAIL"), "its result is of another oracle"),
        (replace(GOOD, verdict="OK"), "its verdict is 'OK', not one of PASS, FAIL, INVALID"),  # type: ignore[arg-type]
        (replace(GOOD, detail=None), "its detail or unit is no text"),  # type: ignore[arg-type]
        (replace(GOOD, actual="1.0"), "'1.0' in place of a number"),  # type: ignore[arg-type]
        (replace(GOOD, limit=math.inf), "its limit inf is not finite; None stands for no limit"),
    ],
)
def test_a_result_of_no_use_names_its_oracle(result: Any, said: str) -> None:
    judge = Judge([Says(result)])
    with pytest.raises((TypeError, ValueError), match=said) as raised:
        judge.results(2.0)
    assert raised.value.__notes__[0] == "(oracle 'own' of twin)"


@pytest.mark.parametrize(
    "flags",
    [
        "flag",
        (Flag(1.0, "own", "twin", None),),  # type: ignore[arg-type]
        (Flag(math.nan, "own", "twin", "fast"),),
    ],
)
def test_a_flag_of_no_use_names_its_oracle_and_reaches_nobody(flags: Any) -> None:
    """A flag without a text ended the whole campaign."""
    judge = Judge([Says(flags=flags)])
    with pytest.raises((TypeError, ValueError)) as raised:
        judge.pose(PoseSample(1.0, "twin", Pose((0, 0, -1)), (0, 0, 0)))
    assert raised.value.__notes__[0] == "(oracle 'own' of twin)"
    assert judge.flags == ()
    assert [one.verdict for one in judge.results(2.0)] == ["INVALID"]
