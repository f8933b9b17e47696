"""Files: meshes and pictures.  Nothing else sees trimesh, imageio or OpenEXR."""
