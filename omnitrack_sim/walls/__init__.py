"""Pipes inside MuJoCo: exact contact and rays, walls of primitives, meshes for export."""
