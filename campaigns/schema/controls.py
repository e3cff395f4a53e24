"""`controls`: runs that must not pass, each with the verdict and the cause that it must have."""

from typing import Annotated, Literal, Self

from pydantic import Field, JsonValue, model_validator

from wil_campaign.campaigns.values.expectation import ControlVerdict
from wil_campaign.foundation.files.documents import KeyFaultError, Part

FlownMode = Literal["sim", "wil", "real"]


class ExpectPart(Part):
    """A control's `expect`. oracle: the one that must fail; cause: a text in the reason.

    One of both is needed: a control that fails for another reason, such as a misspelt parameter of
    its autonomy, proves nothing about the campaign.

    verdict: the one with which the run must end. cause may have {real.pose_source} and
    {twin.pose_source}, which are replaced by that vehicle's pose source: mocap, simulator or
    mavlink.
    """

    verdict: ControlVerdict = "FAIL"
    oracle: Annotated[str, Field(min_length=1)] | None = None
    cause: Annotated[str, Field(min_length=3)] | None = None

    @model_validator(mode="after")
    def _says_why(self) -> Self:
        """Require an oracle or a cause in a control's `expect`."""
        if self.oracle is None and self.cause is None:
            raise ValueError("name the oracle that must fail, or a text of the reason as `cause`")
        if self.oracle is not None and self.verdict != "FAIL":
            message = f"an oracle fails with FAIL, not {self.verdict}: give the cause as `cause`"
            raise KeyFaultError("oracle", message)
        return self


class ControlPart(Part):
    """A control of a campaign. case: the changed one, by default the first; set: the changes.

    modes: by default all of the campaign.
    """

    expect: ExpectPart
    set_: Annotated[dict[str, JsonValue], Field(alias="set", min_length=1)]
    case: str | None = None
    modes: Annotated[list[FlownMode], Field(min_length=1)] | None = None
