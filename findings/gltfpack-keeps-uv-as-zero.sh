#!/usr/bin/env bash
# Package: gltfpack 1.3.0 (npm), option -kv, which keeps what no material needs.
# Input: a square with the uv (.25 .25) (.75 .25) (.75 .75) (.25 .75) as float32, without a texture.
# Seen: TEXCOORD_0 is kept, but as uint16 without a KHR_texture_transform that would bring the values back:
#   without a material, not normalized: (0 0) (0 0) (0 0) (0 0)
#   with a material of one colour, normalized: (0 0) (4095 0) (4095 4095) (0 4095), which is 0 to .0625 instead of .25 to .75
#   with -vtf (float uv) also given: (.25 .25) (.75 .25) (.75 .75) (.25 .75), right
# Why it matters: a skin for fur often carries uv for maps of length and colour that the glTF file does not name. After
# gltfpack -kv every hair looks up a corner of the map, without a warning.
# Known: gltfpack's author says in his pull request 719 that -vtf is needed here; the help and the README of 1.3.0 do not.
set -euo pipefail
dir=$(mktemp -d)
trap 'rm -rf "$dir"' EXIT
cd "$dir"
npm install --silent --no-audit --no-fund gltfpack@1.3.0

cat > try.mjs <<'JS'
import fs from "node:fs";
import { execFileSync } from "node:child_process";

const corners = new Float32Array([0, 0, 0, 1, 0, 0, 1, 1, 0, 0, 1, 0]);
const uv = new Float32Array([.25, .25, .75, .25, .75, .75, .25, .75]);
const faces = new Uint16Array([0, 1, 2, 0, 2, 3]);
fs.writeFileSync("in.bin", Buffer.concat([corners, uv, faces].map((array) => Buffer.from(array.buffer))));

function uvAfter(materials, ...options) {
  const primitive = { attributes: { POSITION: 0, TEXCOORD_0: 1 }, indices: 2 };
  const file = {
    asset: { version: "2.0" }, scene: 0, scenes: [{ nodes: [0] }], nodes: [{ mesh: 0 }], meshes: [{ primitives: [primitive] }],
    buffers: [{ byteLength: 92, uri: "in.bin" }],
    bufferViews: [
      { buffer: 0, byteOffset: 0, byteLength: 48, target: 34962 },
      { buffer: 0, byteOffset: 48, byteLength: 32, target: 34962 },
      { buffer: 0, byteOffset: 80, byteLength: 12, target: 34963 }],
    accessors: [
      { bufferView: 0, componentType: 5126, count: 4, type: "VEC3", min: [0, 0, 0], max: [1, 1, 0] },
      { bufferView: 1, componentType: 5126, count: 4, type: "VEC2" },
      { bufferView: 2, componentType: 5123, count: 6, type: "SCALAR" }] };
  if (materials) { file.materials = materials; primitive.material = 0; }
  fs.writeFileSync("in.gltf", JSON.stringify(file));
  execFileSync("node_modules/.bin/gltfpack", ["-i", "in.gltf", "-o", "out.gltf", "-kv", ...options]);
  const out = JSON.parse(fs.readFileSync("out.gltf"));
  const accessor = out.accessors[out.meshes[0].primitives[0].attributes.TEXCOORD_0];
  const view = out.bufferViews[accessor.bufferView];
  const bytes = fs.readFileSync(out.buffers[view.buffer].uri);
  const float = accessor.componentType === 5126;
  const values = [];
  for (let i = 0; i < accessor.count; i++) for (const axis of [0, 1]) {
    const at = (view.byteOffset ?? 0) + (accessor.byteOffset ?? 0) + i * (view.byteStride ?? (float ? 8 : 4)) + axis * (float ? 4 : 2);
    values.push(float ? bytes.readFloatLE(at) : bytes.readUInt16LE(at));
  }
  const undone = JSON.stringify(out).includes("KHR_texture_transform");
  return `${accessor.componentType} ${accessor.normalized ?? false} ${undone} ${values}`;
}

const seen = [uvAfter(null), uvAfter([{ pbrMetallicRoughness: { baseColorFactor: [1, 0, 0, 1] } }]), uvAfter(null, "-vtf")];
console.log("component type, normalized, texture transform, uv:\n" + seen.join("\n"));
const known = ["5123 false false 0,0,0,0,0,0,0,0", "5123 true false 0,0,4095,0,4095,4095,0,4095"];
// With -vtf the order of the corners is gltfpack's own.
if (seen[0] !== known[0] || seen[1] !== known[1] || !/^5126 false false [.\d,]*0\.75/.test(seen[2])) {
  console.error("changed: gltfpack -kv writes other uv than before");
  process.exit(1);
}
JS
node try.mjs
