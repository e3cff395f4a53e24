"""Strategies of a search that learn from the values of their proposals: optuna's TPE and CMA-ES."""

import warnings
from collections.abc import Iterator
from contextlib import contextmanager
from importlib.util import find_spec
from typing import Any

import numpy as np

from wil_campaign.plugins.search.exploration.space import SearchSpace, SpaceParameter
from wil_campaign.plugins.search.exploration.strategies import (
    FixedStrategy,
    MissingExtraError,
    Point,
    SearchStrategy,
    StrategyProposal,
    fixed_points,
    point_key,
    random_point,
)
from wil_campaign.plugins.search.search_part import ParameterValue, StrategyName

_ATTEMPTS = 50
"""Inadmissible proposals in a row after which a random admissible point is enqueued."""


def make_strategy(name: StrategyName, space: SearchSpace, seed: int) -> SearchStrategy:
    """Return a strategy by its name. Raises MissingExtraError where its package is missing."""
    if find_spec("scipy") is None:
        raise MissingExtraError("scipy", "the coverage of a search")
    if name in {"tpe", "cma-es"}:
        return LearningStrategy(name, space, seed)
    return FixedStrategy(fixed_points(name, space, seed))


class LearningStrategy:
    """An optuna study in memory; its proposals depend on the seed and the reported values alone.

    Several proposals may be without a value; TPE then treats them as bad ("constant liar"), so that
    they lie apart.
    """

    def __init__(self, name: StrategyName, space: SearchSpace, seed: int) -> None:
        self._optuna = _import_optuna(name)
        self._space = space
        self._rng = np.random.default_rng(seed)
        self._trials: dict[int, Any] = {}
        points = space.listed()
        self._unseen = None if points is None else {point_key(point): point for point in points}
        with _quiet():
            self._study = self._optuna.create_study(sampler=self._sampler(name, seed))

    def ask(self) -> StrategyProposal | None:
        """Return a proposal that keeps the constraints and, in a finite space, is new."""
        for attempt in range(2 * _ATTEMPTS):
            if attempt >= _ATTEMPTS and not self._enqueue():
                return None
            with _quiet():
                trial = self._study.ask()
                point = {
                    parameter.name: _suggested(trial, parameter)
                    for parameter in self._space.parameters
                }
            if self._is_new(point):
                self._trials[trial.number] = trial
                return StrategyProposal(trial.number, point)
            self._study.tell(trial, state=self._optuna.trial.TrialState.FAIL)
        return None

    def tell(self, number: int, value: float | None) -> None:
        """Report the value of a proposal; None withdraws it."""
        trial = self._trials.pop(number)
        with _quiet():
            if value is None:
                self._study.tell(trial, state=self._optuna.trial.TrialState.FAIL)
            else:
                self._study.tell(trial, value)

    def _sampler(self, name: StrategyName, seed: int) -> Any:
        samplers = self._optuna.samplers
        seed %= 2**32
        if name == "cma-es":
            independent = samplers.RandomSampler(seed=seed)
            return samplers.CmaEsSampler(seed=seed, independent_sampler=independent)
        return samplers.TPESampler(seed=seed, multivariate=True, constant_liar=True)

    def _enqueue(self) -> bool:
        """Enqueue a random admissible point as the next trial; return whether there is one."""
        if self._unseen is not None:
            if not self._unseen:
                return False
            keys = list(self._unseen)
            point = self._unseen[keys[int(self._rng.integers(len(keys)))]]
        else:
            found = random_point(self._space, self._rng)
            if found is None:
                return False
            point = found
        with _quiet():
            self._study.enqueue_trial(
                {
                    parameter.name: _written(parameter, point[parameter.name])
                    for parameter in self._space.parameters
                }
            )
        return True

    def _is_new(self, point: Point) -> bool:
        """Return whether a point may be proposed: once only in a finite space."""
        if not self._space.admits(point):
            return False
        if self._unseen is None:
            return True
        key = point_key(point)
        is_new = key in self._unseen
        self._unseen.pop(key, None)
        return is_new


def _suggested(trial: Any, parameter: SpaceParameter) -> ParameterValue:
    if parameter.choices:
        # Optuna treats True and 1 as the same choice, so that choices are given by index.
        every = list(range(len(parameter.choices)))
        return parameter.choices[int(trial.suggest_categorical(parameter.name, every))]
    if parameter.is_integer:
        return int(trial.suggest_int(parameter.name, int(parameter.low), int(parameter.high)))
    given = trial.suggest_float(parameter.name, parameter.low, parameter.high)
    return parameter.rounded(float(given))


def _written(parameter: SpaceParameter, value: ParameterValue) -> ParameterValue | None:
    """Return a parameter's value in optuna's form: the index of a choice."""
    return parameter.choice_index(value) if parameter.choices else value


def _import_optuna(name: str) -> Any:
    """Return the module optuna, with its log silenced. Raises MissingExtraError."""
    package = "optuna"
    try:
        with _quiet():
            import optuna  # noqa: PLC0415 - of an extra

            if name == "cma-es":
                package = "cmaes"
                import cmaes  # noqa: F401, PLC0415 - of an extra; optuna imports it later
    except ModuleNotFoundError as error:
        raise MissingExtraError(package, f"the strategy {name}") from error
    optuna.logging.set_verbosity(optuna.logging.ERROR)
    return optuna


@contextmanager
def _quiet() -> Iterator[None]:
    """Silence optuna's warnings of experimental arguments."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        yield
