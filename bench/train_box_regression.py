#!/usr/bin/env python3
"""Trains the network of `[box_regression]`: where a target's borders are, told of a box near it and of frame 1.

Usage:
  pip install torch numpy pillow
  bench/train_box_regression.py --data data --half b --out b.json                  # photographs, and the tracks of half b
  foveate eval --seqs data/tracking data/tracking-wide --set box_regression.weights={other}.json
  bench/train_box_regression.py --data data --out natural-boxes.json               # of both halves, as it ships

It sees two pictures in 32 x 32 cells, each of a box and half its size more on every side: frame 1's of the target, and one of a box that lies
beside the target, is too large, too small, or far from it. Six tenths of a batch are pairs of frames of a track, with its true boxes;
the others pieces of photographs put before others, then turned, bent, of another size, before another background (the picture itself, or
moved, or another one). The second picture is covered in part, blurred, lit, made noisy; both are grey, mirrored or, half of the batches,
of other colours and turned by quarters. What is made small: |error| / s + log s of centre and log size, s being what it is expected to err
by; the cross-entropy of "the target is not here" (IoU below 0.1). Aspect ratio and overlap are asked for besides, and not kept.

3300 steps take four minutes on a fast GPU, and hours on two cores. Not the same to the last bit on GPUs. Output: JSON that
crates/foveate-core/src/identity/box_regression/network.rs reads, weights as bytes with a scale a filter.
"""
import argparse
import base64
import glob
import hashlib
import json
import math
import os
import sys

import numpy as np
import torch
import torch.nn as nn
import torch.nn.functional as F
from PIL import Image

from sequences import sequences

SIDE, REACH = 32, 2.0  # cells of a picture along a side; half sides of the box that they reach
KEPT, BOXES = 120, 6  # pixels along a side of what is kept of a frame, and how many boxes they cover
PHOTO = (481, 321)


# ---- pictures ----


def surroundings(image, box):
    """The box and what is around it, KEPT x KEPT pixels of BOXES boxes; outside the picture its border goes on."""
    x, y, width, height = box
    step = width * BOXES / KEPT, height * BOXES / KEPT
    finer = max(1, min(4, math.ceil(max(step))))
    at = (torch.arange(KEPT * finer) + 0.5) / finer - KEPT / 2
    gx = (2 * (x + at * step[0]) + 1) / image.shape[2] - 1
    gy = (2 * (y + at * step[1]) + 1) / image.shape[1] - 1
    grid = torch.stack(torch.meshgrid(gy, gx, indexing="ij")[::-1], -1)[None].float()
    seen = F.grid_sample(image[None].float(), grid, mode="bilinear", padding_mode="border", align_corners=False)
    return F.avg_pool2d(seen, finer)[0].round().to(torch.uint8).permute(1, 2, 0)


def opened(path):
    return torch.from_numpy(np.asarray(Image.open(path).convert("RGB")).copy()).permute(2, 0, 1)


def tracks(data, half):
    """Of each sequence: what is kept of its frames, and widths and heights of the true boxes."""
    out = []
    for name, files, truth in sequences(data, half):
        chosen = [i for i in range(0, len(files), 2 if len(files) > 120 else 1) if truth[i][2:].min() >= 4]
        out.append((torch.stack([surroundings(opened(files[i]), truth[i]) for i in chosen]), truth[chosen][:, 2:]))
        print(f"{name}: {len(chosen)} frames", flush=True)
    return out


def photographs(data):
    """Wide ones, and the same at half and a quarter of the size."""
    wide = lambda image: image if image.shape[2] > image.shape[1] else torch.rot90(image, 1, (1, 2))
    levels = [torch.stack([wide(opened(f)) for f in sorted(glob.glob(data + "/natural/*.jpg"))])]
    for _ in range(2):
        x = levels[-1].float()
        x = F.pad(x, (0, x.shape[3] % 2, 0, x.shape[2] % 2), mode="replicate")
        levels.append(F.avg_pool2d(x, 2).round().to(torch.uint8))
    return [x.permute(0, 2, 3, 1).contiguous() for x in levels]


def bilinear(flat, base, width, height, x, y):
    """Of pictures laid end to end (pixels x 3), each beginning at `base`."""
    x, y = torch.minimum(x.clamp(min=0), width - 1.001), torch.minimum(y.clamp(min=0), height - 1.001)
    i, j = x.floor(), y.floor()
    a, b, wide = (x - i)[..., None], (y - j)[..., None], width.long()
    at = base + (j * width + i).long()
    read = lambda offset: flat[at + offset].float()
    return (read(0) * (1 - a) + read(1) * a) * (1 - b) + (read(wide) * (1 - a) + read(wide + 1) * a) * b


# ---- pairs of pictures ----


class Pairs:
    def __init__(self, tracks, photographs, device):
        self.device = device
        self.count = len(photographs[0])
        self.photographs = torch.cat([x.reshape(-1, 3) for x in photographs]).to(device)
        starts = np.cumsum([0] + [x[..., 0].numel() for x in photographs])[:-1]
        self.levels = torch.tensor([(s, x.shape[2], x.shape[1], x[0, ..., 0].numel()) for s, x in zip(starts, photographs)], device=device)
        self.frames = torch.cat([x for x, _ in tracks]).reshape(-1, 3).to(device)
        self.sizes = torch.cat([torch.from_numpy(sizes) for _, sizes in tracks]).float().to(device)
        lengths = [len(x) for x, _ in tracks]
        self.lengths = torch.tensor(lengths, device=device)
        self.starts = torch.tensor(np.cumsum([0] + lengths)[:-1], device=device)
        at = (torch.arange(SIDE, device=device) + 0.5) / SIDE * 2 * REACH - REACH
        self.y, self.x = (z.reshape(1, -1) for z in torch.meshgrid(at, at, indexing="ij"))

    def uniform(self, *shape):
        return torch.rand(*shape, device=self.device)

    def normal(self, *shape):
        return torch.randn(*shape, device=self.device)

    def photograph(self, which, x, y, pixels):
        """Photographs at places (pixels); cells of so many pixels read the level that has about one."""
        level = pixels.log2().round().clamp(0, 2).long()
        start, width, height, size = self.levels[level].T
        back = lambda z, side: side - (z.remainder(2 * side) - side).abs()
        scale = (2.0**level)[:, None]
        place = (back(x, PHOTO[0]) + 0.5) / scale - 0.5, (back(y, PHOTO[1]) + 0.5) / scale - 0.5
        return bilinear(self.photographs, (start + which * size)[:, None], width[:, None].float(), height[:, None].float(), *place)

    def waves(self, n, cells):
        grid = torch.stack([self.x / 2.6, self.y / 2.6], -1).view(1, SIDE, SIDE, 2).expand(n, -1, -1, -1)
        return F.grid_sample(self.normal(n, 2, cells, cells), grid, align_corners=True, mode="bicubic").flatten(2)

    def boxes(self, n):
        """Centres, in half sides of the target, and log sizes of the boxes that are looked at: most near it, a quarter off it."""
        wide, off = self.uniform(n) < 0.3, self.uniform(n) < 0.25
        centre = self.normal(n, 2) * torch.where(wide, 0.5, 0.16)[:, None]
        turn, far = self.uniform(n) * 2 * math.pi, self.uniform(n) * 1.6 + 1.9
        there = torch.stack([turn.cos(), turn.sin()], 1)
        there = there / there.abs().amax(1, keepdim=True) * far[:, None]
        return torch.where(off[:, None], there, centre), self.normal(n) * torch.where(wide, 0.3, 0.13)

    def of_photographs(self, n):
        a, b = (torch.randint(self.count, (n,), device=self.device) for _ in range(2))
        b = torch.where(self.uniform(n) < 0.5, a, b)
        half, aspect = torch.exp(self.uniform(n) * math.log(6) + math.log(10)) / 2, torch.exp(self.normal(n) * 0.25)
        w, h = (half * aspect)[:, None], (half / aspect)[:, None]
        column = lambda low, high: (self.uniform(n) * (high - low) + low)[:, None]
        ax, ay, bx, by = column(20, 461), column(20, 301), column(0, 481), column(0, 321)
        whole = (self.uniform(n) < 0.4)[:, None]  # frame 1 is a photograph as it is
        b, bx, by = torch.where(whole[:, 0], a, b), torch.where(whole, ax, bx), torch.where(whole, ay, by)
        power, rx, ry = column(2, 6), column(0.75, 1.1), column(0.75, 1.1)
        outline = self.waves(n, 5) * 0.12 * self.uniform(n)[:, None, None]

        def mask(x, y):
            off = ((x + outline[:, 0]) / rx).abs().clamp(max=4) ** power + ((y + outline[:, 1]) / ry).abs().clamp(max=4) ** power
            return ((1.1 - off) / 0.35).clamp(0, 1)[..., None]

        pixels = half * 2 / 16
        at_first = torch.maximum(mask(self.x, self.y), whole[..., None].float())
        first = self.photograph(a, ax + self.x * w, ay + self.y * h, pixels) * at_first
        first = first + self.photograph(b, bx + self.x * w, by + self.y * h, pixels) * (1 - at_first)
        centre, log_scale = self.boxes(n)
        scale = log_scale.exp()[:, None]
        x, y = self.x * scale + centre[:, :1], self.y * scale + centre[:, 1:]
        angle, stretch, shear = self.normal(n, 1) * 0.17, torch.exp(self.normal(n, 1) * 0.07), self.normal(n, 1) * 0.07
        bend = self.waves(n, 6) * (self.normal(n).abs() * 0.06)[:, None, None]
        px, py = (x * stretch + shear * y) * w, y / stretch * h
        tx = (angle.cos() * px - angle.sin() * py) / w + bend[:, 0]
        ty = (angle.sin() * px + angle.cos() * py) / h + bend[:, 1]
        pixels, other = pixels * scale[:, 0], (self.uniform(n) < 0.08)[:, None]
        target = self.photograph(a, torch.where(other, column(0, 481), ax) + tx * w, torch.where(other, column(0, 321), ay) + ty * h, pixels)
        kind, zoom = self.uniform(n, 1), torch.exp(self.normal(n, 1) * 0.3)
        moved = lambda at, unit, side: torch.where(
            kind < 0.5, at + self.normal(n, 1) * 0.3 * unit, torch.where(kind < 0.75, at + self.normal(n, 1) * 4 * unit, self.uniform(n, 1) * side)
        )
        behind = torch.where(kind[:, 0] < 0.8, b, torch.randint(self.count, (n,), device=self.device))
        ground = self.photograph(behind, moved(bx, w, 481) + x * w * zoom, moved(by, h, 321) + y * h * zoom, pixels * zoom[:, 0])
        gone = (self.uniform(n) < 0.05)[:, None]
        there = torch.where(gone, 0.0, mask(tx, ty).squeeze(-1))[..., None]
        return first, target * there + ground * (1 - there), centre, log_scale, torch.zeros(n, device=self.device), (other | gone)[:, 0]

    def of_tracks(self, n, changed):
        which = torch.randint(len(self.starts), (n,), device=self.device)
        length = self.lengths[which].float()
        a, far = (self.uniform(n) * length).long(), torch.exp(self.uniform(n) * length.log()).long()
        b = torch.where(self.uniform(n) < 0.5, a + far, a - far)
        b = torch.where(self.uniform(n) < 0.3, (self.uniform(n) * length).long(), b) % self.lengths[which]
        i, j = self.starts[which] + a, self.starts[which] + b
        aspect = lambda k: (self.sizes[k, 0] / self.sizes[k, 1]).log()
        log_aspect = (aspect(j) - aspect(i)).clamp(-1, 1)  # boxes have frame 1's
        centre, log_scale = self.boxes(n)
        scale, even = log_scale.exp()[:, None], torch.exp(-0.5 * log_aspect)[:, None]
        x, y = self.x * scale * even + centre[:, :1], self.y * scale / even + centre[:, 1:]
        if changed:
            on, root = (self.uniform(n, 1) < 0.5).float(), aspect(j).exp().sqrt()[:, None]
            angle, stretch = self.normal(n, 1) * 0.12 * on, torch.exp(self.normal(n, 1) * 0.05 * on)
            px, py = x * root * stretch, y / root / stretch
            x, y = (angle.cos() * px - angle.sin() * py) / root, (angle.sin() * px + angle.cos() * py) * root
        side, unit = torch.full((n, 1), float(KEPT), device=self.device), KEPT / BOXES / 2
        read = lambda k, x, y: bilinear(self.frames, (k * KEPT * KEPT)[:, None], side, side, x * unit + KEPT / 2 - 0.5, y * unit + KEPT / 2 - 0.5)
        return read(i, self.x, self.y), read(j, x, y), centre, log_scale, log_aspect, torch.zeros(n, dtype=torch.bool, device=self.device)

    def blurred(self, picture, axis, width):
        width = width[:, None]
        kernel = (width / 2 + 0.5 - torch.arange(-4, 5, device=self.device)[None].abs()).clamp(0, 1)
        kernel = kernel / kernel.sum(1, keepdim=True)
        padded = F.pad(picture, (4, 4, 0, 0) if axis == 3 else (0, 0, 4, 4), mode="replicate")
        return sum(kernel[:, k].view(-1, 1, 1, 1) * padded.narrow(axis, k, SIDE) for k in range(9))

    def changed(self, first, second):
        n = len(first)
        picture = lambda x: x.view(n, SIDE, SIDE, 3).permute(0, 3, 1, 2)
        first, second, one = picture(first), picture(second), (n, 1, 1, 1)
        often = lambda p: self.uniform(n) < p
        # A photograph over a part of the box.
        side, share = torch.randint(4, (n,), device=self.device), self.uniform(n) * 0.6
        along = torch.stack([self.x, -self.x, self.y, -self.y])[:, 0][side]
        across = torch.stack([self.y, self.y, self.x, self.x])[:, 0][side]
        hidden = (along > 1 - 2 * share[:, None]) & (along < (1 + self.uniform(n) * 1.2)[:, None]) & (across.abs() < (0.4 + 1.8 * self.uniform(n))[:, None])
        which, step = torch.randint(self.count, (n,), device=self.device), torch.exp(self.uniform(n, 1) * 2) * 2
        cover = self.photograph(which, self.uniform(n, 1) * 481 + self.x * step * 4, self.uniform(n, 1) * 321 + self.y * step * 4, step[:, 0] / 2)
        second = torch.where((hidden & often(0.4)[:, None]).view(n, 1, SIDE, SIDE), picture(cover), second)
        moves, level, far = often(0.3), often(0.5), self.uniform(n) * 5 + 1
        second = self.blurred(second, 3, torch.where(moves & level, far, 1.0))
        second = self.blurred(second, 2, torch.where(moves & ~level, far, 1.0))
        soft = [torch.where(often(0.25), self.uniform(n) * 2 + 1, 1.0) for _ in range(2)]
        second, first = (self.blurred(self.blurred(x, 3, w), 2, w) for x, w in zip((second, first), soft))
        second = second * torch.exp(self.normal(*one) * 0.2 + self.normal(n, 3, 1, 1) * 0.05) + self.normal(*one) * 12
        gamma = 255 * (second.clamp(1, 255) / 255) ** torch.exp(self.normal(*one) * 0.25)
        second = torch.where(often(0.3).view(one), gamma, second)
        slope = torch.where(often(0.5).view(one), self.x.view(1, 1, SIDE, SIDE), self.y.view(1, 1, SIDE, SIDE))
        second = second * torch.where(often(0.3).view(one), (slope * self.normal(*one) * 0.1).exp(), 1.0)
        second = second + self.normal(*second.shape) * self.uniform(*one) * 6
        first = first + self.normal(*first.shape) * self.uniform(*one) * 4
        grey, luma = often(0.25).view(one), torch.tensor([0.299, 0.587, 0.114], device=self.device).view(1, 3, 1, 1)
        both = [torch.where(grey, (x * luma).sum(1, keepdim=True).expand(-1, 3, -1, -1), x) for x in (first, second)]
        return [x.clamp(0, 255) for x in both]

    def batch(self, n, share):
        k = int(n * share)
        parts = [self.of_photographs(n - k)] * (n > k) + [self.of_tracks(k, torch.rand(1).item() < 0.5)] * (k > 0)
        first, second, centre, log_scale, log_aspect, gone = (torch.cat(x) for x in zip(*parts))
        first, second = self.changed(first, second)
        if torch.rand(1).item() < 0.5:  # other colours; half of them turned by quarters
            order = torch.stack([torch.randperm(3, device=self.device) for _ in range(16)])[torch.randint(16, (n,), device=self.device)]
            order = torch.where((self.uniform(n) < 0.5)[:, None], order, torch.arange(3, device=self.device))[:, :, None, None]
            negative = (self.uniform(n) < 0.15).view(-1, 1, 1, 1)
            first, second = (torch.where(negative, 255 - x, x) for x in (x.gather(1, order.expand_as(x)) for x in (first, second)))
            mixed = torch.randperm(n, device=self.device)
            first, second, centre, log_scale, log_aspect, gone = (x[mixed] for x in (first, second, centre, log_scale, log_aspect, gone))
            for _ in range(torch.randint(4, (1,)).item()):
                turned = lambda x: torch.cat([x[: n // 2], torch.rot90(x[n // 2 :], 1, (2, 3))])
                first, second = turned(first), turned(second)
                centre = torch.cat([centre[: n // 2], torch.stack([centre[n // 2 :, 1], -centre[n // 2 :, 0]], 1)])
                log_aspect = torch.cat([log_aspect[: n // 2], -log_aspect[n // 2 :]])
        mirrored = self.uniform(n) < 0.5
        first, second = (torch.where(mirrored.view(-1, 1, 1, 1), x.flip(3), x) for x in (first, second))
        centre = torch.where(mirrored[:, None], centre * torch.tensor([-1.0, 1.0], device=self.device), centre)
        return first, second, truth(centre, log_scale, log_aspect, gone)


def truth(centre, log_scale, log_aspect, gone):
    """Where the target is from the box, in the box's half sides, log size and half the log aspect ratio; the overlap."""
    scale, even = log_scale.exp(), torch.exp(-0.5 * log_aspect)
    half = torch.stack([scale * even, scale / even], 1)
    low, high = torch.maximum(centre - half, -torch.ones_like(half)), torch.minimum(centre + half, torch.ones_like(half))
    both = (high - low).clamp(min=0).prod(1)
    overlap = torch.where(gone, 0.0, both / (4 + 4 * half.prod(1) - both))
    return torch.cat([-centre / half, -log_scale[:, None], 0.5 * log_aspect[:, None]], 1), overlap


# ---- the network, as network.rs has it ----


class Network(nn.Module):
    def __init__(self):
        super().__init__()
        block = lambda i, o, size, stride: nn.Sequential(
            nn.Conv2d(i, o, size, stride=stride, padding=size // 2, bias=False), nn.BatchNorm2d(o), nn.ReLU()
        )
        self.first, self.second, self.third = block(3, 16, 5, 2), block(16, 32, 3, 2), nn.Conv2d(32, 32, 3, padding=1)
        self.search, self.template = nn.Conv2d(32, 16, 1), nn.Conv2d(32, 16, 1)
        self.joint, self.narrow = block(25 + 16 + 16, 48, 3, 1), block(48, 48, 3, 2)
        self.dense, self.answer = nn.Conv2d(48, 64, 4), nn.Conv2d(64, 7, 1)
        self.besides = nn.Conv2d(64, 3, 1)  # aspect ratio, what it errs by, overlap: not kept

    def features(self, picture):
        mean = picture.mean((1, 2, 3), keepdim=True)
        deviation = (picture.mean(1, keepdim=True) - mean).pow(2).mean((2, 3), keepdim=True).sqrt()
        return self.third(self.second(self.first((picture - mean) / (deviation + 8))))

    def forward(self, first, second):
        there, here = self.features(torch.cat([first, second])).chunk(2)
        even = lambda x: x / (x.pow(2).mean(1, keepdim=True) + 0.01).sqrt()
        around, middle = F.pad(even(there), (2, 2, 2, 2)), even(here)
        compared = [(middle * around[:, :, i : i + 8, j : j + 8]).mean(1) for i in range(5) for j in range(5)]
        joined = torch.cat([torch.stack(compared, 1), self.search(here), self.template(there)], 1)
        dense = F.relu(self.dense(self.narrow(self.joint(joined))))
        return torch.cat([self.answer(dense), self.besides(dense)], 1)[:, :, 0, 0]


def cost(said, offsets, overlap):
    error, spread = (said[:, [0, 1, 2, 7]] - offsets).abs(), said[:, [3, 4, 5, 8]].clamp(-4, 2)
    there = ((error * torch.exp(-spread) + spread) * torch.tensor([1, 1, 1, 0.5], device=said.device)).sum(1) * (overlap > 0.1)
    lost = F.binary_cross_entropy_with_logits(said[:, 6], (overlap <= 0.1).float())
    return there.mean() + 2 * lost + 5 * ((said[:, 9] - overlap) ** 2).mean(), error


@torch.no_grad()
def judged(network, pairs, share, batches=8):
    """Mean errors where the box is near the target, beside those of staying."""
    network.eval()
    rows = []
    for _ in range(batches):
        first, second, (offsets, overlap) = pairs.batch(512, share)
        _, error = cost(network(first, second), offsets, overlap)
        near = (overlap > 0.1) & (offsets[:, :2].abs().amax(1) < 0.5) & (offsets[:, 2].abs() < 0.4)
        rows.append(torch.cat([error[:, :3], offsets[:, :3].abs()], 1)[near])
    network.train()
    return "right %.3f down %.3f size %.3f (staying: %.3f %.3f %.3f)" % tuple(torch.cat(rows).mean(0).tolist())


def train(network, pairs, args):
    optimiser = torch.optim.AdamW(network.parameters(), lr=0.002, weight_decay=0.01)
    kept = []
    for step in range(args.steps):
        for group in optimiser.param_groups:
            group["lr"] = 0.002 * min(1, (step + 1) / 200) * (0.5 * (1 + math.cos(math.pi * step / args.steps)) + 0.01)
        if len(kept) < 4 or step % 2 == 0:  # making a batch costs more than learning from it: each is seen about twice
            kept = (kept + [pairs.batch(args.batch, args.share)])[-6:]
        first, second, (offsets, overlap) = kept[-1 if step % 2 == 0 else step // 2 % len(kept)]
        if step % 4 == 3:
            first, second, offsets = first.flip(3), second.flip(3), offsets * torch.tensor([-1.0, 1, 1, 1], device=args.device)
        loss, _ = cost(network(first, second), offsets, overlap)
        optimiser.zero_grad(set_to_none=True)
        loss.backward()
        nn.utils.clip_grad_norm_(network.parameters(), 2.0)
        optimiser.step()
        if (step + 1) % 500 == 0:
            print(f"step {step + 1}: {loss.item():.3f}; {judged(network, pairs, 1.0)}", flush=True)


def save(network, path, command, data):
    text = lambda x, kind: base64.b64encode(x.detach().cpu().contiguous().numpy().astype(kind).tobytes()).decode()
    layers = []
    for name, layer in network.eval().named_children():
        if name == "besides":
            continue
        if isinstance(layer, nn.Sequential):  # the normalisation goes into the weights
            gain = layer[1].weight / torch.sqrt(layer[1].running_var + layer[1].eps)
            weights, bias = layer[0].weight * gain[:, None, None, None], layer[1].bias - layer[1].running_mean * gain
        else:
            weights, bias = layer.weight, layer.bias
        scale = (weights.abs().amax((1, 2, 3)) / 127).clamp(min=1e-12)
        whole = (weights / scale[:, None, None, None]).round().clamp(-127, 127).permute(2, 3, 1, 0)
        layers.append({"name": name, "shape": list(whole.shape), "weights": text(whole, "i1"), "scales": text(scale, "<f4"), "bias": text(bias, "<f4")})
    with open(path + ".part", "w") as file:
        file.write(json.dumps({"command": command, "data": data, "layers": layers}, indent=1) + "\n")
    os.replace(path + ".part", path)


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--data", required=True)
    parser.add_argument("--out", required=True)
    parser.add_argument("--half", choices=["a", "b"], help="tracks of this half alone")
    parser.add_argument("--share", type=float, default=0.6, help="of tracks in a batch")
    parser.add_argument("--steps", type=int, default=3300)
    parser.add_argument("--batch", type=int, default=1024)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--device", default="cuda" if torch.cuda.is_available() else "cpu")
    args = parser.parse_args()
    torch.manual_seed(args.seed)
    with torch.no_grad():
        pairs = Pairs(tracks(args.data, args.half), photographs(args.data), args.device)
    network = Network().to(args.device)
    train(network, pairs, args)
    print(f"tracks: {judged(network, pairs, 1.0)}; photographs: {judged(network, pairs, 0.0)}")
    half = f" --half {args.half}" if args.half else ""
    command = f"bench/train_box_regression.py --data DATA{half} --share {args.share} --steps {args.steps} --batch {args.batch} --seed {args.seed} --out FILE"
    digest = hashlib.sha256(pairs.frames.cpu().numpy().tobytes() + pairs.photographs.cpu().numpy().tobytes()).hexdigest()
    save(network, args.out, command, f"tracks of {f'half {args.half}' if args.half else 'both halves'} and photographs, sha256 {digest}")


if __name__ == "__main__":
    sys.exit(main())
