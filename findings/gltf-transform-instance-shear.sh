#!/usr/bin/env bash
# Packages: @gltf-transform/core 4.5.1 and @gltf-transform/functions 4.5.1 (npm).
# Input: two nodes with one mesh, each turned 45 degrees about z under a parent with the scale (3, 1, 1). The product of the
#   two has shear, which three lists of translation, rotation and scale cannot hold.
# Seen: instance() makes one batch of both, without a warning, and writes ROTATION (0, 0, .350, .903), a quaternion of the length
#   .969. The point (1, 0, 0), truly at (2.121, .707), goes to (1.652, 1.506) if the reader makes the length one and to
#   (1.688, 1.414) if it uses the quaternion as it is: wrong either way, and two pictures of one file.
# Why it matters: grass and tufts of fur are scattered as instances. A scene that was right before this step has its tufts
# turned and stretched after it. Leave nodes with shear as nodes, or apply the matrix to the vertices.
set -euo pipefail
dir=$(mktemp -d)
trap 'rm -rf "$dir"' EXIT
cd "$dir"
npm install --silent --no-audit --no-fund @gltf-transform/core@4.5.1 @gltf-transform/functions@4.5.1

cat > try.mjs <<'JS'
import { Document } from "@gltf-transform/core";
import { instance } from "@gltf-transform/functions";

const warnings = [];
const keep = (text) => warnings.push(text);
const file = new Document().setLogger({ debug() {}, info() {}, warn: keep, error: keep });
const corners = file.createAccessor().setType("VEC3").setArray(new Float32Array([0, 0, 0, 1, 0, 0, 0, 1, 0])).setBuffer(file.createBuffer());
const mesh = file.createMesh().addPrimitive(file.createPrimitive().setAttribute("POSITION", corners));
const scene = file.createScene();
for (const x of [0, 5]) {
  const turned = file.createNode().setMesh(mesh).setRotation([0, 0, Math.sin(Math.PI / 8), Math.cos(Math.PI / 8)]);
  scene.addChild(file.createNode().setTranslation([x, 0, 0]).setScale([3, 1, 1]).addChild(turned));
}
const m = scene.listChildren()[0].listChildren()[0].getWorldMatrix();
await file.transform(instance({ min: 2 }));

const batch = file.getRoot().listNodes().map((node) => node.getExtension("EXT_mesh_gpu_instancing")).find(Boolean);
if (!batch) { console.error("changed: instance() makes no batch of nodes with shear"); process.exit(1); }
const q = batch.getAttribute("ROTATION").getElement(0, []), s = batch.getAttribute("SCALE").getElement(0, []);
const length = Math.hypot(...q);
// Where (1, 0, 0) goes by a quaternion (0, 0, z, w), as 1 - 2 z z and 2 z w.
const moved = (z, w) => [s[0] * (1 - 2 * z * z), s[0] * 2 * z * w].map((v) => v.toFixed(3));
const unit = moved(q[2] / length, q[3] / length), plain = moved(q[2], q[3]);
console.log("quaternion", q.map((v) => v.toFixed(3)).join(" "), "length", length.toFixed(3), "warnings", warnings.length);
console.log("(1, 0, 0) is truly at", m[0].toFixed(3), m[1].toFixed(3), "made unit:", ...unit, "as it is:", ...plain);
if (Math.abs(length - 1) < 1e-3 || warnings.length) {
  console.error("changed: instance() writes unit quaternions or warns");
  process.exit(1);
}
JS
node try.mjs
