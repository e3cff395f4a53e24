"""A campaign file that names other campaigns as its parts."""

from typing import Annotated, Literal

from pydantic import Field

from wil_campaign.campaigns.schema.campaign import Mode, PublishedPart, SafeName
from wil_campaign.foundation.files.documents import Part

FileName = Annotated[str, Field(min_length=1)]


class CompositionPart(Part):
    """A campaign of campaigns. campaigns: by name, each a file beside this one.

    modes, repetitions, seed: for all of them; null: those of each file. fly_controls: whether their
    controls are flown too. published: results of others, by `part.case`. schema: the kind and
    version of the file. campaign: its name, also of the folder of results. description: for people.
    """

    schema_: Annotated[Literal["wil/campaign/1"], Field(alias="schema")]
    campaign: SafeName
    description: str = ""
    campaigns: Annotated[dict[SafeName, FileName], Field(min_length=1)]
    modes: Annotated[list[Mode], Field(min_length=1)] | None = None
    repetitions: Annotated[int, Field(ge=1, le=100_000)] | None = None
    seed: Annotated[int, Field(ge=0, lt=2**63)] | None = None
    fly_controls: bool = True
    published: PublishedPart | None = None
