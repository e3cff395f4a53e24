"""Meshes from files: .obj, .stl, .glb, .gltf, .dae, .ply."""
