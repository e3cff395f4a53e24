"""A world file as scenes: which objects exist in W and in Wv, by mode of the run."""

from dataclasses import dataclass

from wil_campaign.foundation.files.documents import BadInput, Document, check_document
from wil_campaign.worlds.geodesy import LocalFrame
from wil_campaign.worlds.scene.motion import StartOnEvent
from wil_campaign.worlds.scene.scene import Scene
from wil_campaign.worlds.world_file.world_reader import PlacedObject, WorldReader
from wil_campaign.worlds.world_file.world_schema import Mode, Which, WorldModel

__all__ = ["Mode", "PlacedObject", "Which", "World"]


@dataclass(frozen=True, slots=True, eq=False)
class World:
    """The world of one world file: places and objects; frame: the local frame on WGS-84.

    ground_down_m: the height (NED, metres) of the open ground; None where the file states none.
    """

    description: str
    frame: LocalFrame
    placed: tuple[PlacedObject, ...]
    ground_down_m: float | None = None

    @classmethod
    def parse(cls, document: Document) -> "World":
        """Return the world in a document; files that it names are relative to it.

        Raises BadInput with every fault found: first those of form, then those of meaning.
        """
        model = check_document(document, WorldModel)
        reader = WorldReader(document, seed=model.seed)
        ground_down_m = None if model.ground_up_m is None else -model.ground_up_m
        placed = reader.read(model.objects, ground_down_m=ground_down_m)
        if reader.problems:
            raise BadInput(sorted(reader.problems, key=lambda each: (each.line, each.column)))
        origin = model.origin
        frame = LocalFrame(
            origin.latitude_deg, origin.longitude_deg, origin.altitude_m, origin.undulation_m
        )
        return cls(model.description, frame, placed, ground_down_m)

    @property
    def objects(self) -> tuple[str, ...]:
        """Return the names of all objects of the world, in the order of the file."""
        return tuple(each.scene_object.name for each in self.placed)

    @property
    def object_ids(self) -> dict[str, int]:
        """Return the ids of all objects of the world by name, also of those in no scene."""
        return {each.scene_object.name: each.scene_object.object_id for each in self.placed}

    @property
    def events(self) -> frozenset[str]:
        """Return the names of the events that motions of the world's objects wait for."""
        starts = (
            each.scene_object.motion.start for each in self.placed if each.scene_object.motion
        )
        return frozenset(start.event for start in starts if isinstance(start, StartOnEvent))

    def scene(self, mode: Mode, which: Which) -> Scene:
        """Return the scene of W or Wv in runs of a mode; ids are the same in all scenes."""
        return Scene(
            tuple(each.scene_object for each in self.placed if each.stands_in(mode, which))
        )
