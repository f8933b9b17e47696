"""Files: meshes and pictures.  Nothing else sees Pillow or OpenEXR."""

# As when all of `clfur.files` was output.
from .output import check_writable, output_path, reason, whole

__all__ = ["check_writable", "output_path", "reason", "whole"]
