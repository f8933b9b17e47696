"""Cryptomatte (Friedman and Jones, "Fully Automatic ID Mattes with Support for Motion Blur and Transparency", 2015;
specification 1.2.0): which objects cover a pixel, those that cover most of it first, in channels of floats."""

import json

import numpy as np

from ..errors import Error

ALL = {-2: "body", -3: "shells", -4: "ground"}   # of ids that are no strand's or type's
LAYERS = {"CryptoStrand": "strand_", "CryptoType": "type_"}
BITS = np.uint64(0xFFFFFFFF)


def murmur3(names: list[bytes]) -> np.ndarray:
    """MurmurHash3_x86_32 of texts, seed 0 (Appleby 2011): uint32 [names]."""
    found = np.zeros(len(names), np.uint32)
    lengths = np.array([len(name) for name in names])
    for n in np.unique(lengths):
        which = np.flatnonzero(lengths == n)
        padded = b"".join(names[k].ljust(-(-n // 4) * 4, b"\0") for k in which)
        words = np.frombuffer(padded, "<u4").reshape(len(which), -1).astype(np.uint64)
        found[which] = _mixed(words, int(n))
    return found


def _mixed(words, n):
    state = np.zeros(len(words), np.uint64)
    for k in range(words.shape[1]):
        word = _turned(words[:, k] * np.uint64(0xCC9E2D51) & BITS, 15) * np.uint64(0x1B873593) & BITS
        state ^= word
        if k < n // 4:   # the last ones are no whole word
            state = (_turned(state, 13) * np.uint64(5) + np.uint64(0xE6546B64)) & BITS
    state ^= np.uint64(n)
    for shift, factor in (16, 0x85EBCA6B), (13, 0xC2B2AE35), (16, 1):
        state = (state ^ state >> np.uint64(shift)) * np.uint64(factor) & BITS
    return state.astype(np.uint32)


def _turned(word, by):
    return (word << np.uint64(by) | word >> np.uint64(32 - by)) & BITS


def hashes_of(names: list[str]) -> np.ndarray:
    """What stands for names in pictures: uint32, as a float32 neither denormal nor infinite nor no number."""
    found = murmur3([name.encode() for name in names])
    exponent = found >> np.uint32(23) & np.uint32(255)
    return np.where((exponent == 0) | (exponent == 255), found ^ np.uint32(1 << 23), found)


def layer(name: str, ids: np.ndarray, shares: np.ndarray) -> tuple[dict, dict]:
    """({channel: [h, w]}, {attribute: text}) of a layer of LAYERS.

    ids: int32 [h, w, ranks], an even number of these: a number, or one of ALL, -1 for nothing.  shares: float32
    likewise, of the pixel's area.  The manifest holds what is there alone.
    """
    there = np.unique(ids[shares > 0])
    names = [ALL.get(k, f"{LAYERS[name]}{k}") for k in there.tolist()]
    hashes = hashes_of(names)
    while len(np.unique(hashes)) < len(hashes):   # two names of one hash: the later gets another
        order = np.argsort(hashes, kind="stable")
        names[order[1:][np.diff(hashes[order]) == 0].max()] += "_"
        hashes = hashes_of(names)
    coded = np.zeros(ids.shape, np.float32)
    seen = shares > 0
    coded[seen] = hashes[np.searchsorted(there, ids[seen])].view(np.float32)
    channels = {}
    for rank in range(ids.shape[2]):
        first, second = "RG" if rank % 2 == 0 else "BA"
        channels[f"{name}{rank // 2:02}.{first}"] = coded[..., rank]
        channels[f"{name}{rank // 2:02}.{second}"] = np.where(seen[..., rank], shares[..., rank], 0).astype(np.float32)
    key = f"cryptomatte/{int(murmur3([name.encode()])[0]):08x}"[:len("cryptomatte/") + 7]
    manifest = {each: f"{code:08x}" for each, code in zip(names, hashes.tolist())}
    return channels, {f"{key}/name": name, f"{key}/hash": "MurmurHash3_32", f"{key}/conversion": "uint32_to_float32",
                      f"{key}/manifest": json.dumps(manifest, separators=(",", ":"))}


def ranked(shares: np.ndarray, body: np.ndarray | None, ranks: int) -> tuple[np.ndarray, np.ndarray]:
    """(ids, shares), both [h, w, ranks], of types' shares [h, w, types] and the body's [h, w], the largest first."""
    ids = np.arange(shares.shape[2], dtype=np.int32)
    if body is not None:
        ids, shares = np.append(ids, np.int32(-2)), np.concatenate([shares, body[..., None]], 2)
    if shares.shape[2] < ranks:
        more = ranks - shares.shape[2]
        ids, shares = np.pad(ids, (0, more)), np.pad(shares, ((0, 0), (0, 0), (0, more)))
    order = np.argsort(-shares, 2, kind="stable")[..., :ranks]
    sorted_ = np.take_along_axis(shares, order, 2)
    return np.where(sorted_ > 0, ids[order], -1), sorted_


def read_layer(name: str, channels: dict, header: dict) -> tuple[np.ndarray, np.ndarray]:
    """(ids, shares) of what `layer` gave; raises Error for a manifest of other names."""
    key = next((key for key, value in header.items() if key.endswith("/name") and value == name), "")
    try:
        manifest = json.loads(header[key.removesuffix("name") + "manifest"])
        codes = {int(code, 16): _id(each, LAYERS[name]) for each, code in manifest.items()}
        pairs = [channels[f"{name}{rank // 2:02}.{'RGBA'[rank % 2 * 2 + k]}"]
                 for rank in range(len(channels) // 2) for k in range(2)]
    except (AttributeError, KeyError, ValueError):
        raise Error(f"has no manifest of {name}, or not all of its channels") from None
    coded, shares = np.stack(pairs[::2], 2), np.stack(pairs[1::2], 2)
    known = np.array(sorted(codes), np.uint32)
    number = np.array([codes[code] for code in known.tolist()] or [-1], np.int32)
    bits = np.ascontiguousarray(coded).view(np.uint32)
    at = np.searchsorted(known, bits).clip(0, max(len(known) - 1, 0))
    if len(known) and (shares[known[at] != bits] > 0).any():
        raise Error(f"has ids that the manifest of {name} does not hold")
    return np.where(shares > 0, number[at], -1).astype(np.int32), shares


def _id(name, before):
    other = {value: key for key, value in ALL.items()}.get(name)
    return other if other is not None else int(name.removeprefix(before).rstrip("_"))
