"""The contract of a policy that another program made: what it sees and what its actions mean."""

from collections.abc import Sequence
from dataclasses import fields
from typing import Annotated, Any, Literal

import numpy as np
from pydantic import BaseModel, ConfigDict, Field, FiniteFloat, ValidationError

from backends.spec import Hand
from backends.state import Array
from tasks import observation
from tasks.observation import ActionLaw, Channel, Percept

Positive = Annotated[FiniteFloat, Field(gt=0)]


class ContractError(ValueError):
    """A contract cannot be kept; the message says what was given and what is allowed."""


class _Part(BaseModel):
    model_config = ConfigDict(extra="forbid", frozen=True)


class _Channel(_Part):
    name: str
    unit: str
    width: int
    scale: Positive


class _Action(_Part):
    name: Literal["desired_joint_displacement"]
    unit: Literal["rad"]
    width: int
    range: tuple[Literal[-1], Literal[1]]
    scale_rad: Positive
    period_s: Annotated[FiniteFloat, Field(ge=1e-3, le=0.5)]
    target_return: Annotated[FiniteFloat, Field(ge=0, le=1)]
    target_lead_rad: Positive
    target_range_rad: tuple[tuple[FiniteFloat, FiniteFloat], ...]
    preload_rad: tuple[FiniteFloat, ...] | None
    default_pose_rad: tuple[FiniteFloat, ...]


class _Contract(_Part):
    schema_: Literal[2] = Field(alias="schema")
    joints: tuple[str, ...]
    observation: tuple[_Channel, ...]
    action: _Action


class Contracted(observation.Observation):
    """The observation that a contract names, made of what the known observations give.

    Its channels may be any of theirs, in any order and scale, its joints in any order.
    """

    def __init__(self, hand: Hand, data: Any, known: Sequence[observation.Observation]) -> None:
        """Raises ContractError for a contract that this hand cannot keep."""
        contract = _read(data)
        if sorted(contract.joints) != sorted(hand.joint_names):
            raise ContractError(
                f"joints are {', '.join(contract.joints)}; allowed: {', '.join(hand.joint_names)}, "
                "in any order"
            )
        order = tuple(map(contract.joints.index, hand.joint_names))
        super().__init__(hand, _law(contract.action, order))
        self.order = order
        self._data, self._known = data, known
        self._channels = tuple(Channel(**one.model_dump()) for one in contract.observation)
        for one in self._channels:
            _match(one, known)

    @property
    def channels(self) -> tuple[Channel, ...]:
        """See `Observation.channels`."""
        return self._channels

    def contract(self) -> dict:
        """See `Observation.contract`."""
        return dict(self._data)

    def read(self, percept: Percept) -> Array:
        """See `Observation.read`."""
        found: dict[str, tuple[Channel, Array]] = {}
        for one in self._known:
            blocks = np.split(one.read(percept), np.cumsum([c.width for c in one.channels]), axis=1)
            found |= {c.name: (c, b) for c, b in zip(one.channels, blocks, strict=False)}
        return np.concatenate(
            [self._block(one, *found[one.name]) for one in self._channels], axis=1
        )

    def extra_channels(self) -> tuple[Channel, ...]:
        """See `Observation.extra_channels`."""
        return self._channels

    def extra(self, percept: Percept) -> tuple[Array, ...]:
        """See `Observation.extra`."""
        return (self.read(percept),)

    def _block(self, wanted: Channel, own: Channel, values: Array) -> Array:
        own_order = np.argsort(self.order) if own.per_joint else slice(None)
        return (values[:, own_order] * (own.scale / wanted.scale)).astype(np.float32)


def _law(action: _Action, order: Sequence[int]) -> ActionLaw:
    """The law, with its joints in the hand's order."""
    numbers = action.model_dump(include={field.name for field in fields(ActionLaw)})
    for name in ("target_range_rad", "preload_rad", "default_pose_rad"):
        row = numbers[name]
        if row is not None and len(row) != len(order):
            raise ContractError(f"action.{name} has {len(row)} items; allowed: {len(order)}")
        numbers[name] = None if row is None else tuple(row[k] for k in order)
    return ActionLaw(**numbers)


def _read(data: Any) -> _Contract:
    try:
        return _Contract.model_validate(data)
    except ValidationError as error:
        wrong = error.errors()[0]
        place = ".".join(map(str, wrong["loc"])) or "it"
        raise ContractError(
            f"{place}: {wrong['msg'].lower()} (given: {wrong['input']!r:.60})"
        ) from None


def _match(wanted: Channel, known: Sequence[observation.Observation]) -> None:
    """Raise ContractError unless a known observation has such a channel."""
    every = {c.name: c for one in known for c in one.channels}
    own = every.get(wanted.name)
    if own is None or (own.unit, own.width) != (wanted.unit, wanted.width):
        allowed = ", ".join(f"{c.name} ({c.width}, {c.unit})" for c in every.values())
        raise ContractError(
            f"the channel {wanted.name} ({wanted.width}, {wanted.unit}) is not known; allowed: "
            f"{allowed}"
        )
