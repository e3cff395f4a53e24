"""What the plugin meshes adds."""

from wil_campaign.hooks import MeshFormat, implements


@implements
def mesh_formats() -> tuple[MeshFormat, ...]:
    """Return the formats of mesh files."""
    return tuple(
        MeshFormat(
            suffix,
            load="wil_campaign.plugins.meshes.mesh_reader:load_mesh_shape",
            named="wil_campaign.plugins.meshes.named_by_mesh:files_named_by_mesh",
        )
        for suffix in (".obj", ".stl", ".glb", ".gltf", ".dae", ".ply")
    )
