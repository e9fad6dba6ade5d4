"""MuJoCo models: walls, robot, looks, meshes. The only users of MjSpec, trimesh and manifold3d."""
