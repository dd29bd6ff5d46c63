#!/usr/bin/env python3
"""Trains the first layer `encoder.kind = "convolutional"`: two layers of filters, of natural photographs and tracks.

Usage:
  pip install torch numpy pillow
  bench/train_network.py --data data --out natural-network.safetensors                  # DATA/natural alone
  bench/train_network.py --data data --half a --out a.safetensors                       # and the tracks of half a, to be judged on half b
  foveate eval --config FILE --seqs data/tracking data/tracking-wide                    # FILE: encoder.weights = "a.safetensors"

A pair is two pictures of one target, the second turned, lit, blurred, deformed and partly covered before other surroundings (photographs),
or some frames later (tracks; their boxes are used). As the tracker does (identity/discriminant.rs), ridge regression learns from
the features of glimpses around the target of the first picture; half its score and half the cosine to the target there judge glimpses
of the second: at the target, beside it, of other sizes, elsewhere. Made small is the mean of 1 - IoU of these places under the weights that a
particle filter of this sharpness gives them. The network and its input are described in crates/foveate-learn/src/network.rs.

Output: a model file, with this command in its metadata. The same command gives the same numbers on one kind of processor. One thread.
"""
import argparse
import glob
import hashlib
import json
import math
import struct
import sys

import numpy as np
import torch
import torch.nn.functional as F
from PIL import Image

from sequences import sequences

RETINA = {"side": 16.0, "rings": [[18, 1]], "colour": [[16, 2]]}
RINGS, SIZES = [0.12, 0.2, 0.35, 0.6, 1.0, 1.7], [-0.2, -0.1, -0.05, 0.05, 0.1, 0.2]  # as in discriminant.rs
LEARNED, JUDGED = 36, 36  # glimpses of the first picture, of the second
SHARPNESS, MIXING, RIDGE = 50.0, 0.5, 0.003
FILTERS, GREY = (16, 48), 0.3


# ---- glimpses, as pyramid.rs and retina.rs read them ----


def channels(rgb):
    r, g, b = (rgb[..., i].astype(np.int32) for i in range(3))
    grey = (r * 19595 + g * 38470 + b * 7471 + 32768) >> 16
    return np.stack([grey, (r - g) // 2 + 128, (2 * b - r - g) // 4 + 128]).astype(np.float32)


def box_means(plane, width, height):
    left, top = (width - 1) // 2, (height - 1) // 2
    padded = np.pad(plane, ((top, height - 1 - top), (left, width - 1 - left)), mode="edge")
    sums = np.zeros((padded.shape[0] + 1, padded.shape[1] + 1))
    sums[1:, 1:] = padded.cumsum(0).cumsum(1)
    total = sums[height:, width:] - sums[:-height, width:] - sums[height:, :-width] + sums[:-height, :-width]
    return (total / (width * height)).astype(np.float32), (width - 1) / 2 - left, (height - 1) / 2 - top


def bilinear(plane, x, y):
    x, y = np.clip(x, 0, plane.shape[1] - 1.001), np.clip(y, 0, plane.shape[0] - 1.001)
    i, j = x.astype(np.int32), y.astype(np.int32)
    a, b = x - i, y - j
    if plane.ndim == 3:
        a, b = a[..., None], b[..., None]
    return (plane[j, i] * (1 - a) + plane[j, i + 1] * a) * (1 - b) + (plane[j + 1, i] * (1 - a) + plane[j + 1, i + 1] * a) * b


def lattice(n, cell):
    at = (np.arange(n) - (n - 1) / 2) * cell
    v, u = np.meshgrid(at, at, indexing="ij")
    return u.ravel(), v.ravel()


LEVELS = [(1 / 8, *lattice(18, 1 / 8)), (1 / 4, *lattice(8, 1 / 4)), (1 / 4, *lattice(8, 1 / 4))]


def glimpses(planes, places, half):
    """Of places (x, y, log scale) of a target with these half sides, bytes."""
    scale, far = np.exp(places[:, 2]), 1.4
    spans = []
    for axis, side in ((0, planes.shape[2]), (1, planes.shape[1])):
        reach = far * scale * half[axis]
        low = int(np.clip((places[:, axis] - reach).min() - 4, 0, side - 2))
        spans.append((low, int(np.clip((places[:, axis] + reach).max() + 5, low + 2, side))))
    (x0, x1), (y0, y1) = spans
    mean, out = math.exp(places[:, 2].mean()), []
    for plane, (side, u, v) in zip(planes[:, y0:y1, x0:x1], LEVELS):
        width, height = (max(1, round(side * mean * h)) for h in half)
        level, dx, dy = box_means(plane, width, height)
        x = places[:, :1] - x0 - dx + u * scale[:, None] * half[0]
        y = places[:, 1:2] - y0 - dy + v * scale[:, None] * half[1]
        out.append(bilinear(level, x, y))
    return np.clip(np.concatenate(out, 1) + 0.5, 0, 255).astype(np.uint8)


def elsewhere(rng, at, unit, size):
    for _ in range(20):
        place = at[0] + rng.uniform(-6, 6) * unit[0], at[1] + rng.uniform(-6, 6) * unit[1]
        inside = 0 <= place[0] < size[0] and 0 <= place[1] < size[1]
        if inside and max(abs(place[0] - at[0]) / unit[0], abs(place[1] - at[1]) / unit[1]) > 0.8:
            break
    return (*place, at[2])


def around(rng, at, unit, size, learned):
    """Places to learn from or to judge, the target's first."""
    places = [at]

    def near(radius, angle, log_scale=0.0):
        places.append((at[0] + radius * math.cos(angle) * unit[0], at[1] + radius * math.sin(angle) * unit[1], at[2] + log_scale))

    if learned:
        for radius in RINGS:
            turn = rng.random() * math.pi
            for i in range(4):
                near(radius, turn + i * math.pi / 2)
        places += [(at[0], at[1], at[2] + d) for d in SIZES]
    else:
        for _ in range(18):
            near(math.exp(rng.uniform(math.log(0.08), math.log(1.7))), rng.random() * 2 * math.pi, (rng.random() < 0.6) * rng.normal() * 0.08)
        places += [(at[0], at[1], at[2] + d + rng.normal() * 0.02) for d in [-0.3, *SIZES, 0.3]]
    while len(places) < (LEARNED if learned else JUDGED):
        places.append(elsewhere(rng, at, unit, size))
    return np.array(places)


def pair(rng, first, box, second, other):
    """Boxes are (x, y, width, height) with (x, y) the middle. Glimpses, and their places in units of the target there."""
    half = box[2] / 2, box[3] / 2
    log_scale = float(np.clip(0.5 * math.log(other[2] * other[3] / (box[2] * box[3])), -1.5, 1.5))
    seen, places = [], []
    for planes, at, learned in ((first, (box[0], box[1], 0.0), True), (second, (other[0], other[1], log_scale), False)):
        unit = half[0] * math.exp(at[2]), half[1] * math.exp(at[2])
        all_places = around(rng, at, unit, planes.shape[:0:-1], learned)
        seen.append(glimpses(planes, all_places, half))
        places.append(((all_places - at) / (*unit, 1.0)).astype(np.float32))
    return np.concatenate(seen), np.concatenate(places)


# ---- pairs of tracks and of photographs ----


def tracks(data, half, count, rng):
    chosen, out = list(sequences(data, half)), []
    for _, files, truth in chosen:
        frames, left = {}, count // len(chosen)
        while left > 0:
            a = rng.integers(len(files))
            b = a + int(math.exp(rng.uniform(0, math.log(120)))) * rng.choice([-1, 1, 1])
            if not 0 <= b < len(files) or min(truth[a][2:].min(), truth[b][2:].min()) < 4:
                continue
            for i in (a, b):
                if i not in frames:
                    frames[i] = channels(np.asarray(Image.open(files[i]).convert("RGB")))
            out.append(pair(rng, frames[a], truth[a], frames[b], truth[b]))
            left -= 1
    return out


def reflected(v, side):
    return side - np.abs(v % (2 * side) - side)


def sample(picture, x, y):
    return bilinear(picture, reflected(x, picture.shape[1] - 1.01), reflected(y, picture.shape[0] - 1.01))


def waves(rng, shape):
    cells = max(4, int(9 * rng.uniform(0.6, 1.6)))
    return np.asarray(Image.fromarray(rng.normal(size=(cells, cells)).astype(np.float32)).resize(shape[::-1], Image.BICUBIC))


def seen_again(rng, pictures, picture, box):
    """The target of a photograph, changed, in a picture of its own; and its box there."""
    x, y, width, height = box
    size = math.exp(rng.normal() * 0.15)
    w, h = width * size, height * size
    shape = min(int(5.5 * h) + 8, 280), min(int(5.5 * w) + 8, 280)
    rows, columns = np.mgrid[0 : shape[0], 0 : shape[1]].astype(np.float32)
    at = rng.uniform(0.3, 0.7) * shape[1], rng.uniform(0.3, 0.7) * shape[0]
    dx, dy = columns - at[0], rows - at[1]
    angle, stretch, shear, bend = rng.normal() * 0.17, math.exp(rng.normal() * 0.08), rng.normal() * 0.08, abs(rng.normal()) * 0.06
    turn = np.array([[math.cos(angle), -math.sin(angle)], [math.sin(angle), math.cos(angle)]])
    m = turn @ np.array([[stretch, shear], [0, 1 / stretch]]) / size
    target = sample(
        picture,
        x + m[0, 0] * dx + m[0, 1] * dy + bend * width * waves(rng, shape),
        y + m[1, 0] * dx + m[1, 1] * dy + bend * height * waves(rng, shape),
    )
    where = rng.random()
    behind = picture if where < 0.6 else pictures[rng.integers(len(pictures))]
    bx, by = rng.uniform(0, behind.shape[1]), rng.uniform(0, behind.shape[0])
    if where < 0.4:  # its own surroundings, a little shifted
        bx, by = x + rng.normal() * 0.15 * width, y + rng.normal() * 0.15 * height
    sin, cos, zoom = math.sin(0.3 * angle), math.cos(0.3 * angle), 1 / (size * math.exp(rng.normal() * 0.1))
    power = rng.uniform(2, 6)
    off = np.abs(2 * dx / w / rng.uniform(0.75, 1.1)) ** power + np.abs(2 * dy / h / rng.uniform(0.75, 1.1)) ** power
    mask = np.clip((1.15 - off) / 0.3, 0, 1)[..., None]
    out = sample(behind, bx + zoom * (cos * dx - sin * dy), by + zoom * (sin * dx + cos * dy)) * (1 - mask) + target * mask
    if rng.random() < 0.35:  # partial cover
        cover, share, side = pictures[rng.integers(len(pictures))], rng.uniform(0.05, 0.4), rng.integers(4)
        edge = [dx < (share - 0.5) * w, dx > (0.5 - share) * w, dy < (share - 0.5) * h, dy > (0.5 - share) * h][side]
        long = np.abs(dy) < h * rng.uniform(0.4, 2) if side < 2 else np.abs(dx) < w * rng.uniform(0.4, 2)
        hidden = edge & long & (np.abs(dx) < 0.8 * w) & (np.abs(dy) < 0.8 * h)
        out = np.where(hidden[..., None], sample(cover, rng.uniform(0, 400) + dx, rng.uniform(0, 300) + dy), out)
    if rng.random() < 0.3:  # motion blur
        n, axis = int(rng.uniform(0.05, 0.35) * max(w, h)), rng.integers(2)
        if n > 1:
            sums = np.cumsum(np.concatenate([out, out.take(range(n), axis)], axis), axis)
            out = (sums.take(range(n, sums.shape[axis]), axis) - sums.take(range(sums.shape[axis] - n), axis)) / n
    out = out * math.exp(rng.normal() * 0.2) * np.exp(rng.normal(size=3) * 0.05) + rng.normal() * 12
    if rng.random() < 0.3:
        out = 255 * (np.clip(out, 0, 255) / 255) ** math.exp(rng.normal() * 0.25)
    out = np.clip(out + rng.normal(size=out.shape) * rng.uniform(0, 5), 0, 255)
    return out.astype(np.uint8), (*at, w, h)


def photographs(data, count, rng):
    pictures = [np.asarray(Image.open(f).convert("RGB")).astype(np.float32) for f in sorted(glob.glob(data + "/natural/*.jpg"))]
    out = []
    while len(out) < count:
        picture = pictures[rng.integers(len(pictures))]
        side, root = math.exp(rng.uniform(math.log(14), math.log(44))), math.exp(rng.normal() * 0.22)
        w, h = side * root, side / root
        x, y = rng.uniform(0.6 * w, picture.shape[1] - 0.6 * w), rng.uniform(0.6 * h, picture.shape[0] - 0.6 * h)
        inside = picture[int(y - h / 2) : int(y + h / 2) + 1, int(x - w / 2) : int(x + w / 2) + 1]
        if inside.mean(2).std() < 10 and rng.random() < 0.8:
            continue
        again, box = seen_again(rng, pictures, picture, (x, y, w, h))
        left, top = max(0, int(x - 4 * w)), max(0, int(y - 4 * h))
        first = channels(picture[top : int(y + 4 * h), left : int(x + 4 * w)].astype(np.uint8))
        second = channels(again)
        if rng.random() < 0.25:
            first[1:], second[1:] = 128, 128
        out.append(pair(rng, first, (x - left, y - top, w, h), second, box))
    return out


# ---- the network, the tracker's judgement, training ----


class Network(torch.nn.Module):
    def __init__(self):
        super().__init__()
        self.first = torch.nn.Conv2d(1, FILTERS[0], 3)
        self.second = torch.nn.Conv2d(FILTERS[0] + 3, FILTERS[1], 2, stride=2)
        y, x = torch.meshgrid(torch.arange(-1.0, 2), torch.arange(-1.0, 2), indexing="ij")
        with torch.no_grad():  # gradients in all directions, nearly
            for k in range(FILTERS[0]):
                angle = 2 * math.pi * k / FILTERS[0]
                self.first.weight[k, 0] = 0.3 * (math.cos(angle) * x + math.sin(angle) * y) + 0.05 * torch.randn(3, 3)
            self.first.bias.zero_()

    def weights(self):
        """Filters of the first layer see no brightness, those of the second little: light changes."""
        first, share = self.first.weight, torch.ones(FILTERS[0] + 3)
        share[FILTERS[0]] = GREY
        return first - first.mean((1, 2, 3), keepdim=True), self.second.weight * share[None, :, None, None]

    def forward(self, values):
        first, second = self.weights()
        grey, colour = values[:, :324], (values[:, 324:].view(-1, 2, 8, 8) - 128 / 255) * 8
        grey = grey - grey.mean(1, keepdim=True)
        grey = (grey / (grey.pow(2).mean(1, keepdim=True).sqrt() + 0.05)).view(-1, 1, 18, 18)
        found = F.avg_pool2d(F.relu(F.conv2d(grey, first, self.first.bias)), 2)
        between = torch.cat([found, F.avg_pool2d(grey[:, :, 1:-1, 1:-1], 2), colour], 1)
        h = (F.relu(F.conv2d(between, second, self.second.bias, stride=2)).permute(0, 2, 3, 1).flatten(1) + 1e-4).sqrt()
        h = h - h.mean(1, keepdim=True)
        return h / (h.norm(dim=1, keepdim=True) + 0.05 * math.sqrt(h.shape[1]))


def cost(network, seen, places):
    """Mean of 1 - IoU of the places judged, weighted as particles are; one a pair."""
    h = network(seen.flatten(0, 1).float() / 255).view(*seen.shape[:2], -1)
    learned, judged = h[:, :LEARNED], h[:, LEARNED:]
    u, v, s = places.unbind(-1)
    labels = torch.exp(-0.5 * ((u**2 + v**2) / 0.2**2 + s**2 / 0.1**2))[:, :LEARNED, None]
    weights = torch.ones(LEARNED, 1)
    weights[1 : 1 + 4 * len(RINGS)] = math.sqrt(2)  # four places of a ring stand for eight
    one = lambda x: torch.cat([x, torch.ones_like(x[..., :1])], -1)
    rows = one(learned) * weights
    kernel = rows @ rows.transpose(1, 2) + RIDGE * torch.eye(LEARNED)
    score = one(judged) @ (rows.transpose(1, 2) @ torch.linalg.solve(kernel, labels * weights))
    template = learned[:, :1]
    cosine = (judged * template).sum(-1) / (judged.norm(dim=-1) * template.norm(dim=-1) + 1e-6)
    distance = (1 - MIXING) * (1 - cosine) + MIXING * (1 - score[..., 0])
    u, v, s = u[:, LEARNED:], v[:, LEARNED:], s[:, LEARNED:].exp()
    along = lambda c: (torch.clamp(c + s, max=1) - torch.clamp(c - s, min=-1)).clamp(min=0)
    both = along(u) * along(v)
    iou = both / (4 + 4 * s * s - both)
    return (F.softmax(-SHARPNESS * distance, 1) * (1 - iou)).sum(1)


def mirrored(seen, places):
    """Left and right changed."""
    flip = lambda x, side: x.unflatten(-1, (-1, side)).flip(-1).flatten(-2)
    return torch.cat([flip(seen[..., :324], 18), flip(seen[..., 324:], 8)], -1), places * torch.tensor([-1.0, 1, 1])


def train(pairs, steps, batch, rate, rng):
    seen, places = (torch.from_numpy(np.stack(x)) for x in zip(*pairs))
    network = Network()
    optimiser = torch.optim.Adam(network.parameters(), lr=rate)
    recent = []
    for step in range(steps):
        for group in optimiser.param_groups:
            group["lr"] = rate * 0.5 * (1 + math.cos(math.pi * step / steps)) * min(1, (step + 1) / 30)
        chosen = torch.from_numpy(rng.integers(len(seen), size=batch))
        some = seen[chosen], places[chosen]
        loss = cost(network, *(mirrored(*some) if rng.random() < 0.5 else some)).mean()
        optimiser.zero_grad()
        loss.backward()
        torch.nn.utils.clip_grad_norm_(network.parameters(), 1.0)
        optimiser.step()
        recent.append(loss.item())
        if (step + 1) % 50 == 0:
            print(f"step {step + 1}: {np.mean(recent[-50:]):.4f}", flush=True)
    return network, hashlib.sha256(seen.numpy().tobytes()).hexdigest()


def save(network, path, metadata):
    """As foveate-learn/src/rbm/io.rs reads it."""
    tensors = {}
    for name, weights in zip(("first", "second"), network.weights()):
        layer = getattr(network, name)
        tensors[name + "_weights"] = weights.detach().permute(2, 3, 1, 0).contiguous().numpy().astype("<f4")
        tensors[name + "_bias"] = layer.bias.detach().numpy().astype("<f4")
    text = lambda x: json.dumps(x, separators=(",", ":"), ensure_ascii=False)
    header = {"format": 1, "kind": "network", "about": {"metadata": metadata}, "sha256": ""}
    seal = hashlib.sha256(text(header).encode())
    for name, values in sorted(tensors.items()):
        seal.update(f"\n{name}[{', '.join(map(str, values.shape))}]\n".encode() + values.tobytes())
    header["sha256"] = seal.hexdigest()
    entries, blob = {"__metadata__": {"foveate": text(header)}}, b""
    for name, values in sorted(tensors.items()):
        entries[name] = {"dtype": "F32", "shape": values.shape, "data_offsets": [len(blob), len(blob) + values.nbytes]}
        blob += values.tobytes()
    head = text(entries).encode()
    head += b" " * (-len(head) % 8)
    with open(path, "wb") as file:
        file.write(struct.pack("<Q", len(head)) + head + blob)


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--data", required=True)
    parser.add_argument("--out", required=True)
    parser.add_argument("--half", choices=["a", "b"], help="tracks of this half too")
    parser.add_argument("--photographs", type=int, default=3600, help="pairs of photographs")
    parser.add_argument("--tracks", type=int, default=1800, help="pairs of tracks")
    parser.add_argument("--steps", type=int, default=250)
    parser.add_argument("--batch", type=int, default=16)
    parser.add_argument("--rate", type=float, default=0.001)
    parser.add_argument("--seed", type=int, default=1)
    args = parser.parse_args()
    torch.set_num_threads(1)
    torch.manual_seed(args.seed)
    rng = np.random.default_rng(args.seed)
    pairs = photographs(args.data, args.photographs, rng) if args.photographs else []
    if args.half:
        pairs += tracks(args.data, args.half, args.tracks, rng)
    print(f"{len(pairs)} pairs", flush=True)
    network, sha256 = train(pairs, args.steps, args.batch, args.rate, rng)
    tracked = f" --half {args.half} --tracks {args.tracks}" if args.half else ""
    command = (
        f"bench/train_network.py --data DATA{tracked} --photographs {args.photographs} --steps {args.steps} --batch {args.batch} "
        f"--rate {args.rate} --seed {args.seed} --out FILE"
    )
    save(network, args.out, {
        "retina": json.dumps(RETINA, separators=(",", ":")),
        "command": command,
        "data": f"{len(pairs)} pairs of photographs" + (f" and of the tracks of half {args.half}" if args.half else ""),
        "data_sha256": sha256,
        "seed": args.seed,
        "epochs": max(1, args.steps * args.batch // len(pairs)),
    })


if __name__ == "__main__":
    sys.exit(main())
