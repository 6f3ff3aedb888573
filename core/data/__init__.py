"""Where training pictures come from: cameras, an off-screen rasteriser, meshes and procedural objects."""
