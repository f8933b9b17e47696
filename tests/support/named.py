"""An OBJ file whose faces have names: a quad, and two triangles beside it."""

OBJ = """o body
v 0 0 0
v 1 0 0
v 1 0 1
v 0 0 1
v 9 9 9
v 2 0 0
v 2 0 1
vn 0 1 0
vn 0 2 1
usemtl Fell weiß
g head ear
f 1//1 4//1 3//1 2//1
usemtl tail
g tail
f 2//2 3//2 7//2
g
f 2//2 7//2 6//2
"""
