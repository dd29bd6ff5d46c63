#!/usr/bin/env python3
"""Trains the network of `[box_regression]`: the borders and the presence of a target, from a box near it and from frame 1.

Usage:
  pip install torch numpy pillow opencv-python-headless
  cp -r data/tracking-train train && bash train/unpack.sh train
  bench/train_box_regression.py --data data --more train --half b --out b.json     # photographs, and the tracks of half b
  foveate eval --seqs data/tracking data/tracking-wide data/tracking-train --half a --set box_regression.weights=b.json
  bench/train_box_regression.py --data data --more train --out natural-boxes.json  # of both halves, as it ships

The network reads two pictures of 64 x 64 cells, each of a box and half its size more on every side: that of the target in frame 1, and that
of a box near the target, of another size or shape, or far from it. Beside them stand the probabilities of the colours of 32 x 32 cells, by
histograms of the first picture. Seven tenths of a batch are pairs of frames of a track, with its true boxes; four tenths of the targets with
masks are cut out and put before photographs. The others are pieces of photographs put before others, then turned, bent, stretched. Four
tenths of the boxes near a track's target have frame 1's shape. The second picture is covered in part, blurred, lit, made noisy; both are
grey, mirrored or, half of the batches, of other colours and turned by quarters.

Two maps say where the corners are. The loss is |error| / s + log s of centre, log size and half the log of width / height, with s the
expected error; the cross-entropy of "the target is not here" (IoU below 0.1) and of the mask, where there is one; and the error of the
overlap. Mask and overlap are not kept. The weights are a running mean over the steps.

A graphics card is used where there is one: 2100 steps of 512 pairs take 4 minutes on an H200 that trains three networks at once. Output: JSON
that crates/foveate-core/src/identity/box_regression/network.rs reads, weights as bytes with a scale for each filter; and beside it FILE.pt,
from which --from FILE.pt goes on.
"""
import argparse
import base64
import copy
import glob
import hashlib
import json
import math
import os
import sys

import cv2
import numpy as np
import torch
import torch.nn as nn
import torch.nn.functional as F
from PIL import Image

from sequences import sequences

SIDE, COARSE, REACH = 64, 32, 2.0  # cells and coarse cells of a picture along a side; half sides of the box that they reach
KEPT, BOXES = 160, 5  # pixels along a side of the stored part of a frame, and how many boxes they cover
PHOTO = (481, 321)
BINS = 8
uniform, normal = torch.rand, torch.randn
DEVICE = "cuda" if torch.cuda.is_available() else "cpu"
FINE = ((torch.arange(16) + 0.5) / 16 * 2 - 1).to(DEVICE) * 2.5  # where the places of a corner's map are, half sides of the box


# ---- pictures ----


def surroundings(image, box):
    """The box and its surroundings, KEPT x KEPT pixels of BOXES boxes; outside the picture its border is repeated."""
    x, y, width, height = box
    finer = max(1, min(4, int(np.ceil(max(width, height) * BOXES / KEPT))))
    at = ((np.arange(KEPT * finer) + 0.5) / finer - KEPT / 2) / KEPT * BOXES
    columns, rows = np.meshgrid((x + at * width).astype(np.float32), (y + at * height).astype(np.float32))
    seen = cv2.remap(image, columns, rows, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)
    return cv2.resize(seen, (KEPT, KEPT), interpolation=cv2.INTER_AREA) if finer > 1 else seen


def tracks(data, more, half):
    """For each sequence: its kind, the stored parts of its frames and masks, and widths and heights of the true boxes."""
    out = []
    for name, kind, folder, files, truth in sequences(data, half, more):
        masks = cv2.imread(f"{folder}/mask.png", cv2.IMREAD_GRAYSCALE) if os.path.exists(f"{folder}/mask.png") else None
        chosen = [i for i in range(0, len(files), -(-len(files) // 80)) if not np.isnan(truth[i]).any() and truth[i][2:].min() >= 3]
        frames, kept = [], []
        for i in chosen:
            image = cv2.imread(files[i])[:, :, ::-1]
            frames.append(surroundings(image, truth[i]))
            rows = image.shape[0]
            mask = np.zeros(image.shape[:2], np.uint8) if masks is None else (masks[i * rows : (i + 1) * rows] > 0).astype(np.uint8) * 255
            kept.append(surroundings(mask, truth[i]))
        both = torch.cat([torch.from_numpy(np.stack(frames)), torch.from_numpy(np.stack(kept))[..., None]], 3)
        out.append((kind, both, masks is not None, truth[chosen][:, 2:]))
        print(f"{name}: {len(chosen)} frames", flush=True)
    return out


def photographs(data):
    """Wide ones, and the same at half and a quarter of the size."""
    opened = lambda path: torch.from_numpy(np.asarray(Image.open(path).convert("RGB")).copy()).permute(2, 0, 1)
    wide = lambda image: image if image.shape[2] > image.shape[1] else torch.rot90(image, 1, (1, 2))
    levels = [torch.stack([wide(opened(f)) for f in sorted(glob.glob(data + "/natural/*.jpg"))])]
    for _ in range(2):
        x = levels[-1].float()
        x = F.pad(x, (0, x.shape[3] % 2, 0, x.shape[2] % 2), mode="replicate")
        levels.append(F.avg_pool2d(x, 2).round().to(torch.uint8))
    return [x.permute(0, 2, 3, 1).contiguous() for x in levels]


def bilinear(flat, base, width, height, x, y):
    """Of pictures laid end to end (pixels x channels), each beginning at `base`."""
    x, y = torch.minimum(x.clamp(min=0), width - 1.001), torch.minimum(y.clamp(min=0), height - 1.001)
    i, j = x.floor(), y.floor()
    a, b, wide = (x - i)[..., None], (y - j)[..., None], width.long()
    at = base + (j * width + i).long()
    read = lambda offset: flat[at + offset].float()
    return (read(0) * (1 - a) + read(1) * a) * (1 - b) + (read(wide) * (1 - a) + read(wide + 1) * a) * b


# ---- colours, as box_regression/colours.rs has them ----


def bins(cells):
    """The eight bins around each colour, and their weights: n x cells x 8."""
    at = (cells / 256 * BINS - 0.5).clamp(0, BINS - 1.001)
    low = at.floor()
    part, low = at - low, low.long()
    index, weight = [], []
    for corner in range(8):
        up = [corner >> 2 & 1, corner >> 1 & 1, corner & 1]
        r, g, b = (low[..., c] + up[c] for c in range(3))
        index.append((r * BINS + g) * BINS + b)
        share = [part[..., c] if up[c] else 1 - part[..., c] for c in range(3)]
        weight.append(share[0] * share[1] * share[2])
    return torch.stack(index, -1), torch.stack(weight, -1)


def histograms(cells):
    """Of the target and of its surroundings: n x 2 x BINS ** 3."""
    at = ((torch.arange(COARSE) + 0.5) / COARSE * 2 * REACH - REACH).abs()
    far = torch.maximum(at[:, None], at[None, :]).reshape(-1)
    n, (index, weight) = len(cells), bins(cells)
    out = torch.zeros(n, 2, BINS**3)
    for k, zone in enumerate([(far < 0.8).float(), (far > 1.1).float()]):
        out[:, k].scatter_add_(1, index.reshape(n, -1), (weight * zone[None, :, None] / zone.sum()).reshape(n, -1))
    return out


def probability(histograms, cells, empty=0.004):
    n, (index, weight) = len(cells), bins(cells)
    of = (histograms[:, 0] + empty / 2) / (histograms.sum(1) + empty)
    return (of.gather(1, index.reshape(n, -1)).reshape(index.shape) * weight).sum(-1)


# ---- pairs of pictures ----


class Pairs:
    def __init__(self, tracks, photographs):
        self.count = len(photographs[0])
        self.photographs = torch.cat([x.reshape(-1, 3) for x in photographs]).to(DEVICE)
        starts = np.cumsum([0] + [x[..., 0].numel() for x in photographs])[:-1]
        self.levels = torch.tensor([(s, x.shape[2], x.shape[1], x[0, ..., 0].numel()) for s, x in zip(starts, photographs)])
        self.frames = torch.cat([frames for _, frames, _, _ in tracks]).reshape(-1, 4).to(DEVICE)
        self.masked = torch.tensor([masked for _, _, masked, _ in tracks])
        self.sizes = torch.cat([torch.from_numpy(sizes) for _, _, _, sizes in tracks]).float().to(DEVICE)
        lengths = [len(frames) for _, frames, _, _ in tracks]
        self.lengths = torch.tensor(lengths)
        self.starts = torch.tensor(np.cumsum([0] + lengths)[:-1])
        often = np.array([0.5 if kind in ("air", "thermal") else 1.0 for kind, _, _, _ in tracks])  # 54 of 159 are specks in the sky
        self.often = torch.from_numpy(often / often.sum()).float().to(DEVICE)
        at = (torch.arange(SIDE) + 0.5) / SIDE * 2 * REACH - REACH
        self.y, self.x = (z.reshape(1, -1) for z in torch.meshgrid(at, at, indexing="ij"))

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
        return F.grid_sample(normal(n, 2, cells, cells), grid, align_corners=True, mode="bicubic").flatten(2)

    def boxes(self, n):
        """Centres, in half sides of the target, log sizes and half log aspects of the boxes: most near it, a quarter off it."""
        wide, off = uniform(n) < 0.3, uniform(n) < 0.25
        centre = normal(n, 2) * torch.where(wide, 0.4, 0.14)[:, None]
        turn, far = uniform(n) * 2 * math.pi, uniform(n) * 1.6 + 1.9
        there = torch.stack([turn.cos(), turn.sin()], 1)
        there = there / there.abs().amax(1, keepdim=True) * far[:, None]
        size = normal(n) * torch.where(wide, 0.3, 0.13)
        return torch.where(off[:, None], there, centre), size, normal(n) * torch.where(uniform(n) < 0.3, 0.3, 0.1)

    def of_photographs(self, n):
        a, b = (torch.randint(self.count, (n,)) for _ in range(2))
        b = torch.where(uniform(n) < 0.5, a, b)
        half, aspect = torch.exp(uniform(n) * math.log(6) + math.log(10)) / 2, torch.exp(normal(n) * 0.35)
        w, h = (half * aspect)[:, None], (half / aspect)[:, None]
        column = lambda low, high: (uniform(n) * (high - low) + low)[:, None]
        ax, ay, bx, by = column(20, 461), column(20, 301), column(0, 481), column(0, 321)
        whole = (uniform(n) < 0.3)[:, None]  # frame 1 is a photograph as it is
        b, bx, by = torch.where(whole[:, 0], a, b), torch.where(whole, ax, bx), torch.where(whole, ay, by)
        power, rx, ry = column(2, 6), column(0.75, 1.1), column(0.75, 1.1)
        outline = self.waves(n, 5) * 0.12 * uniform(n)[:, None, None]

        def mask(x, y):
            off = ((x + outline[:, 0]) / rx).abs().clamp(max=4) ** power + ((y + outline[:, 1]) / ry).abs().clamp(max=4) ** power
            return ((1.1 - off) / 0.35).clamp(0, 1)[..., None]

        pixels = half * 2 * REACH / SIDE
        at_first = torch.maximum(mask(self.x, self.y), whole[..., None].float())
        first = self.photograph(a, ax + self.x * w, ay + self.y * h, pixels) * at_first
        first = first + self.photograph(b, bx + self.x * w, by + self.y * h, pixels) * (1 - at_first)
        centre, log_scale, half_aspect = self.boxes(n)
        scale, wider = log_scale.exp()[:, None], half_aspect.exp()[:, None]
        x, y = self.x * scale * wider + centre[:, :1], self.y * scale / wider + centre[:, 1:]
        angle, stretch, shear = normal(n, 1) * 0.12, torch.exp(normal(n, 1) * 0.05), normal(n, 1) * 0.07
        squeezed = torch.exp(normal(n, 1) * 0.2 * (uniform(n, 1) < 0.5))  # of the ground: the target has become wider or taller
        bend = self.waves(n, 6) * (normal(n).abs() * 0.06)[:, None, None]
        px, py = (x * stretch + shear * y) * w, y / stretch * h
        tx = (angle.cos() * px - angle.sin() * py) / w + bend[:, 0]
        ty = (angle.sin() * px + angle.cos() * py) / h + bend[:, 1]
        pixels, other = pixels * scale[:, 0], (uniform(n) < 0.08)[:, None]
        target = self.photograph(a, torch.where(other, column(0, 481), ax) + tx * w, torch.where(other, column(0, 321), ay) + ty * h, pixels)
        kind, zoom = uniform(n, 1), torch.exp(normal(n, 1) * 0.3)
        moved = lambda at, unit, side: torch.where(
            kind < 0.5, at + normal(n, 1) * 0.3 * unit, torch.where(kind < 0.75, at + normal(n, 1) * 4 * unit, uniform(n, 1) * side)
        )
        behind = torch.where(kind[:, 0] < 0.8, b, torch.randint(self.count, (n,)))
        gx, gy = x * squeezed, y / squeezed
        ground = self.photograph(behind, moved(bx, w, 481) + gx * w * zoom, moved(by, h, 321) + gy * h * zoom, pixels * zoom[:, 0])
        gone = (uniform(n) < 0.05)[:, None]
        there = torch.where(gone, 0.0, mask(tx, ty).squeeze(-1))[..., None]
        gone = (other | gone)[:, 0]
        second, mask = target * there + ground * (1 - there), there[..., 0] * (~gone)[:, None]
        return first, second, centre, log_scale, half_aspect, gone, mask, torch.ones(n, dtype=torch.bool)

    def of_tracks(self, n):
        which = torch.multinomial(self.often, n, replacement=True)
        length = self.lengths[which].float()
        a, far = (uniform(n) * length).long(), torch.exp(uniform(n) * length.log()).long()
        b = torch.where(uniform(n) < 0.5, a + far, a - far)
        b = torch.where(uniform(n) < 0.3, (uniform(n) * length).long(), b) % self.lengths[which]
        i, j = self.starts[which] + a, self.starts[which] + b
        aspect = lambda k: (self.sizes[k, 0] / self.sizes[k, 1]).log()
        change = (aspect(j) - aspect(i)).clamp(-1.6, 1.6)
        centre, log_scale, half_aspect = self.boxes(n)
        half_aspect = torch.where(uniform(n) < 0.4, -0.5 * change, half_aspect)  # the box has frame 1's
        scale, wider = log_scale.exp()[:, None], half_aspect.exp()[:, None]
        x, y = self.x * scale * wider + centre[:, :1], self.y * scale / wider + centre[:, 1:]
        on, root = (uniform(n, 1) < 0.4).float(), aspect(j).exp().sqrt()[:, None]
        angle, stretch = normal(n, 1) * 0.1 * on, torch.exp(normal(n, 1) * 0.05 * on)
        px, py = x * root * stretch, y / root / stretch
        x, y = (angle.cos() * px - angle.sin() * py) / root, (angle.sin() * px + angle.cos() * py) * root
        side, unit = torch.full((n, 1), float(KEPT)), KEPT / BOXES / 2
        read = lambda k, x, y: bilinear(self.frames, (k * KEPT * KEPT)[:, None], side, side, x * unit + KEPT / 2 - 0.5, y * unit + KEPT / 2 - 0.5)
        first, second = read(i, self.x, self.y), read(j, x, y)
        masked, mask = self.masked[which], second[..., 3] / 255
        cut = masked & (uniform(n) < 0.4)
        if cut.any():
            k = cut.nonzero()[:, 0]
            n = len(k)
            mask_1, mask_2 = first[k, :, 3:] / 255, mask[k][..., None]
            one = torch.randint(self.count, (n,))
            two = torch.where(uniform(n) < 0.6, one, torch.randint(self.count, (n,)))
            at, down, step = uniform(n, 1) * 481, uniform(n, 1) * 321, torch.exp(uniform(n, 1) * 1.8) * 1.5 * 8
            pixels = step[:, 0] * 2 * REACH / SIDE
            before = self.photograph(one, at + self.x * step, down + self.y * step, pixels)
            now = self.photograph(two, at + normal(n, 1) * step * 0.5 + x[k] * step, down + normal(n, 1) * step * 0.5 + y[k] * step, pixels * scale[k, 0])
            both = (uniform(n) < 0.6)[:, None, None]
            first[k, :, :3] = torch.where(both, first[k, :, :3] * mask_1 + before * (1 - mask_1), first[k, :, :3])
            second[k, :, :3] = second[k, :, :3] * mask_2 + now * (1 - mask_2)
        gone = torch.zeros(len(which), dtype=torch.bool)
        return first[..., :3], second[..., :3], centre, log_scale, half_aspect, gone, mask, masked

    def blurred(self, picture, axis, width):
        width = width[:, None]
        kernel = (width / 2 + 0.5 - torch.arange(-8, 9)[None].abs()).clamp(0, 1)
        kernel = kernel / kernel.sum(1, keepdim=True)
        padded = F.pad(picture, (8, 8, 0, 0) if axis == 3 else (0, 0, 8, 8), mode="replicate")
        return sum(kernel[:, k].view(-1, 1, 1, 1) * padded.narrow(axis, k, SIDE) for k in range(17))

    def changed(self, first, second):
        n = len(first)
        picture = lambda x: x.view(len(x), SIDE, SIDE, 3).permute(0, 3, 1, 2)
        first, second, one = picture(first), picture(second), (n, 1, 1, 1)
        often = lambda p: uniform(n) < p
        # A photograph over a part of the box.
        side, share = torch.randint(4, (n,)), uniform(n) * 0.6
        along = torch.stack([self.x, -self.x, self.y, -self.y])[:, 0][side]
        across = torch.stack([self.y, self.y, self.x, self.x])[:, 0][side]
        hidden = (along > 1 - 2 * share[:, None]) & (along < (1 + uniform(n) * 1.2)[:, None]) & (across.abs() < (0.4 + 1.8 * uniform(n))[:, None])
        which, step = torch.randint(self.count, (n,)), torch.exp(uniform(n, 1) * 2) * 2
        k = often(0.3).nonzero()[:, 0]
        if len(k):
            at, down = uniform(len(k), 1) * 481, uniform(len(k), 1) * 321
            cover = picture(self.photograph(which[k], at + self.x * step[k] * 4, down + self.y * step[k] * 4, step[k, 0] * 16 / SIDE))
            second[k] = torch.where(hidden[k].view(-1, 1, SIDE, SIDE), cover, second[k])
        moves, level, far = often(0.3), often(0.5), uniform(n) * 10 + 1
        second = self.blurred(second, 3, torch.where(moves & level, far, 1.0))
        second = self.blurred(second, 2, torch.where(moves & ~level, far, 1.0))
        second = second * torch.exp(normal(*one) * 0.15 + normal(n, 3, 1, 1) * 0.04) + normal(*one) * 8
        gamma = lambda: 255 * (second.clamp(1, 255) / 255) ** torch.exp(normal(*one) * 0.2)
        second = torch.where(often(0.3).view(one), gamma(), second)
        second = second + normal(*second.shape) * uniform(*one) * 6
        first = first + normal(*first.shape) * uniform(*one) * 4
        grey, luma = often(0.2).view(one), torch.tensor([0.299, 0.587, 0.114]).view(1, 3, 1, 1)
        return [torch.where(grey, (x * luma).sum(1, keepdim=True).expand(-1, 3, -1, -1), x).clamp(0, 255) for x in (first, second)]

    def batch(self, n, share):
        k = int(n * share)
        parts = [self.of_photographs(n - k)] * (n > k) + [self.of_tracks(k)] * (k > 0)
        first, second, centre, log_scale, half_aspect, gone, mask, masked = (torch.cat(x) for x in zip(*parts))
        first, second = self.changed(first, second)
        mask = mask.view(n, SIDE, SIDE)
        if uniform(1).item() < 0.5:  # other colours; half of them turned by quarters
            order = torch.stack([torch.randperm(3) for _ in range(16)])[torch.randint(16, (n,))]
            order = torch.where((uniform(n) < 0.5)[:, None], order, torch.arange(3))[:, :, None, None]
            negative = (uniform(n) < 0.07).view(-1, 1, 1, 1)
            first, second = (torch.where(negative, 255 - x, x) for x in (x.gather(1, order.expand_as(x)) for x in (first, second)))
            quarters, q, mixed = torch.randint(4, (1,)).item(), n // 2, torch.randperm(n)
            first, second, centre, log_scale, half_aspect, gone, mask, masked = (
                x[mixed] for x in (first, second, centre, log_scale, half_aspect, gone, mask, masked)
            )
            for _ in range(quarters):
                turned = lambda x: torch.cat([x[:q], torch.rot90(x[q:], 1, (-2, -1))])
                first, second, mask = turned(first), turned(second), turned(mask)
                centre = torch.cat([centre[:q], torch.stack([centre[q:, 1], -centre[q:, 0]], 1)])
                half_aspect = torch.cat([half_aspect[:q], -half_aspect[q:]])
        mirrored = uniform(n) < 0.5
        first, second = (torch.where(mirrored.view(-1, 1, 1, 1), x.flip(3), x) for x in (first, second))
        mask = torch.where(mirrored.view(-1, 1, 1), mask.flip(2), mask)
        centre = torch.where(mirrored[:, None], centre * torch.tensor([-1.0, 1.0]), centre)
        cells = lambda x: F.avg_pool2d(x, 2).permute(0, 2, 3, 1).reshape(n, -1, 3)
        found = histograms(cells(first))
        colours = [probability(found, cells(x)).view(n, 1, COARSE, COARSE) for x in (first, second)]
        return [first, second, *colours], *truth(centre, log_scale, half_aspect, gone), mask, masked


def truth(centre, log_scale, half_aspect, gone):
    """Where the target is from the box, in the box's half sides, log size and half the log aspect; the overlap."""
    half = torch.stack([(log_scale + half_aspect).exp(), (log_scale - half_aspect).exp()], 1)
    low, high = torch.maximum(centre - half, -torch.ones_like(half)), torch.minimum(centre + half, torch.ones_like(half))
    both = (high - low).clamp(min=0).prod(1)
    overlap = torch.where(gone, 0.0, both / (4 + 4 * half.prod(1) - both))
    return torch.cat([-centre / half, -log_scale[:, None], -half_aspect[:, None]], 1), overlap


# ---- the network, as network.rs has it ----


class Network(nn.Module):
    def __init__(self):
        super().__init__()
        block = lambda i, o, size, stride: nn.Sequential(
            nn.Conv2d(i, o, size, stride=stride, padding=size // 2, bias=False), nn.BatchNorm2d(o), nn.ReLU()
        )
        self.first, self.second, self.third = block(3, 16, 5, 2), block(17, 32, 3, 2), block(32, 64, 3, 2)
        self.fourth = nn.Conv2d(64, 32, 3, padding=1)
        self.search, self.template = nn.Conv2d(32, 16, 1), nn.Conv2d(32, 16, 1)
        self.joint, self.again, self.narrow = block(25 + 16 + 16, 64, 3, 1), block(64, 64, 3, 1), block(64, 48, 3, 2)
        self.dense, self.answer = nn.Conv2d(48, 64, 4), nn.Conv2d(64, 5, 1)
        self.corners = nn.Conv2d(64, 8, 3, padding=1)  # 2 x 2 quarters of each place, of two corners
        y, x = torch.meshgrid(FINE.cpu(), FINE.cpu(), indexing="ij")
        self.prior = nn.Parameter(torch.stack([-2 * ((x + 1) ** 2 + (y + 1) ** 2), -2 * ((x - 1) ** 2 + (y - 1) ** 2)]))
        self.besides = nn.Conv2d(64, 1, 1)  # overlap: not kept
        self.mask = nn.Conv2d(64, 16, 1)  # 4 x 4 cells of each place: not kept

    def features(self, picture, colours):
        mean = picture.mean((1, 2, 3), keepdim=True)
        deviation = (picture.mean(1, keepdim=True) - mean).pow(2).mean((2, 3), keepdim=True).sqrt()
        found = self.first((picture - mean) / (deviation + 8))
        return self.fourth(self.third(self.second(torch.cat([found, (4 * (colours - 0.5)).to(found.dtype)], 1))))

    def forward(self, first, second, first_colours, second_colours):
        there, here = self.features(torch.cat([first, second]), torch.cat([first_colours, second_colours])).chunk(2)
        even = lambda x: x / (x.pow(2).mean(1, keepdim=True) + 0.01).sqrt()
        around, middle = F.pad(even(there.float()), (2, 2, 2, 2)), even(here.float())
        compared = torch.stack([(middle * around[:, :, i : i + 8, j : j + 8]).mean(1) for i in range(5) for j in range(5)], 1)
        joined = self.again(self.joint(torch.cat([compared.to(here.dtype), self.search(here), self.template(there)], 1)))
        dense = F.relu(self.dense(self.narrow(joined)))
        logits = F.pixel_shuffle(self.corners(joined), 2).float() + self.prior
        maps = logits.flatten(2).softmax(2).view(-1, 2, 16, 16)
        x, y = (maps.sum(2) * FINE).sum(2), (maps.sum(3) * FINE).sum(2)  # of both corners
        wide, high = (((z[:, 1] - z[:, 0]) / 2).clamp(min=0.1).log() for z in (x, y))
        place = torch.stack([x.mean(1), y.mean(1), (wide + high) / 2, (wide - high) / 2], 1)
        rest = [self.answer(dense)[:, :, 0, 0].float(), self.besides(dense)[:, :, 0, 0].float()]
        return torch.cat([place, *rest], 1), F.pixel_shuffle(self.mask(joined), 4)[:, 0].float()


def cost(answer, masks, offsets, overlap, mask, masked):
    error, spread = (answer[:, :4] - offsets).abs(), answer[:, 4:8].clamp(-4, 2)
    there = (error * torch.exp(-spread) + spread).sum(1) * (overlap > 0.1)
    lost = F.binary_cross_entropy_with_logits(answer[:, 8], (overlap <= 0.1).float())
    shapes = F.binary_cross_entropy_with_logits(masks, mask, reduction="none").mean((1, 2))
    shapes = (shapes * masked).sum() / (masked.sum() + 1e-6)
    return there.mean() + 2 * lost + 5 * ((answer[:, 9] - overlap) ** 2).mean() + 2 * shapes, error


def train(network, pairs, args):
    """The running mean of the weights over the steps."""
    optimiser = torch.optim.AdamW(network.parameters(), lr=0.002, weight_decay=0.02)
    kept, mean = [], copy.deepcopy(network)
    numbers = lambda network: [x for x in [*network.parameters(), *network.buffers()] if x.dtype.is_floating_point]
    for step in range(args.steps):
        for group in optimiser.param_groups:
            group["lr"] = 0.002 * min(1, (step + 1) / 200) * (0.5 * (1 + math.cos(math.pi * step / args.steps)) + 0.005)
        with torch.no_grad():
            kept = (kept + [pairs.batch(args.batch, args.share)])[-4:]
        # Making a batch costs more than learning from it: each is seen twice, once mirrored.
        for mirrored, (pictures, offsets, overlap, mask, masked) in ((False, kept[-1]), (True, kept[torch.randint(len(kept), (1,)).item()])):
            if mirrored:
                pictures, mask, offsets = [x.flip(3) for x in pictures], mask.flip(2), offsets * torch.tensor([-1.0, 1, 1, 1])
            with torch.autocast(DEVICE, dtype=torch.bfloat16, enabled=DEVICE == "cuda"):
                answer, masks = network(*pictures)
            loss, error = cost(answer, masks, offsets, overlap, F.avg_pool2d(mask[:, None], 2)[:, 0], masked)
            optimiser.zero_grad(set_to_none=True)
            loss.backward()
            nn.utils.clip_grad_norm_(network.parameters(), 2.0)
            optimiser.step()
            with torch.no_grad():
                torch._foreach_lerp_(numbers(mean), numbers(network), 1 - min(0.999, (step + 1) / (step + 20)))
        if (step + 1) % 100 == 0:
            near = (overlap > 0.1) & (offsets.abs().amax(1) < 0.5)
            errors, staying = (", ".join(f"{x:.3f}" for x in each[near].abs().mean(0)) for each in (error, offsets))
            print(f"step {step + 1}: {loss.item():.3f}; errors right, down, size, shape {errors} (staying: {staying})", flush=True)
    return mean


def save(network, path, command, data):
    text = lambda x, kind: base64.b64encode(x.detach().cpu().contiguous().numpy().astype(kind).tobytes()).decode()
    layers = []
    for name, layer in network.eval().named_children():
        if name in ("besides", "mask"):
            continue
        if isinstance(layer, nn.Sequential):  # the normalisation goes into the weights
            gain = layer[1].weight / torch.sqrt(layer[1].running_var + layer[1].eps)
            weights, bias = layer[0].weight * gain[:, None, None, None], layer[1].bias - layer[1].running_mean * gain
        else:
            weights, bias = layer.weight, layer.bias
        if name == "corners":  # each place has a bias of its own
            bias = bias.view(-1, 1, 1) + F.pixel_unshuffle(network.prior[None], 2)[0]
            bias = bias.permute(1, 2, 0).reshape(-1)
        scale = (weights.abs().amax((1, 2, 3)) / 127).clamp(min=1e-12)
        whole = (weights / scale[:, None, None, None]).round().clamp(-127, 127).permute(2, 3, 1, 0)
        layers.append({"name": name, "shape": list(whole.shape), "weights": text(whole, "i1"), "scales": text(scale, "<f4"), "bias": text(bias, "<f4")})
    with open(path + ".part", "w") as file:
        file.write(json.dumps({"command": command, "data": data, "layers": layers}, indent=1) + "\n")
    os.replace(path + ".part", path)


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--data", required=True)
    parser.add_argument("--more", help="a copy of tracking-train whose unpack.sh was run")
    parser.add_argument("--out", required=True)
    parser.add_argument("--half", choices=["a", "b"], help="tracks of this half alone")
    parser.add_argument("--share", type=float, default=0.7, help="of tracks in a batch")
    parser.add_argument("--steps", type=int, default=2700)
    parser.add_argument("--batch", type=int, default=512)
    parser.add_argument("--from", dest="start", help="FILE.pt of an earlier run")
    parser.add_argument("--seed", type=int, default=0)
    args = parser.parse_args()
    torch.manual_seed(args.seed)
    torch.set_default_device(DEVICE)
    pairs = Pairs(tracks(args.data, args.more, args.half), photographs(args.data))
    network = Network().to(DEVICE)
    if args.start:
        network.load_state_dict(torch.load(args.start, map_location=DEVICE))
    network = train(network, pairs, args)
    torch.save(network.state_dict(), args.out + ".pt")
    half = f" --half {args.half}" if args.half else ""
    start = f" --from {args.start}" if args.start else ""
    command = f"bench/train_box_regression.py --data DATA --more TRAIN{half} --share {args.share} --steps {args.steps} --batch {args.batch} --seed {args.seed}{start} --out FILE"
    digest = hashlib.sha256(pairs.frames.cpu().numpy().tobytes() + pairs.photographs.cpu().numpy().tobytes()).hexdigest()
    save(network, args.out, command, f"tracks of {f'half {args.half}' if args.half else 'both halves'} and photographs, sha256 {digest}")


if __name__ == "__main__":
    sys.exit(main())
