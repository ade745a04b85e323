"""The network: a small residual encoder, a decoder by addition, and two heads for every second pixel.

One head says what a cell shows, and while it trains also votes for the box of the visible part of its instance; the
other says which cells around are the same instance (`autowaze.vehicle.semantics.cell_links`). Both ask only for dense
supervision, which a network of this size learns from scratch in hours. The votes make the trunk look for
whole vehicles; they are not exported.
"""

from __future__ import annotations

import torch
from torch import nn
from torch.nn import functional

from autowaze.vehicle.semantics.cell_links import CLASSES, LINKS

STRIDE = 32
SHOWN, VOTED = 1 + len(CLASSES), 4 + 1
"""Channels that say what a cell shows; of its vote."""
DISTANCE_UNIT = 8.0
_WIDTHS = (16, 24, 48, 96, 144)
"""Channels at strides 2, 4, 8, 16, 32: most of the work is done at 8 and 16, where an instance is a few cells wide."""
_BLOCKS = (0, 1, 1, 2, 2)
_DECODED = (80, 48, 32)
"""The same in the decoder, at strides 16, 8, 4."""
_SEAMS = 40
"""Channels from which links are told, at stride 4."""


class Conv(nn.Sequential):
    """Convolution, batch normalisation, and ReLU unless told otherwise."""

    def __init__(self, inputs: int, outputs: int, size: int = 3, stride: int = 1, relu: bool = True) -> None:
        super().__init__()
        self.conv = nn.Conv2d(inputs, outputs, size, stride, size // 2, bias=False)
        self.norm = nn.BatchNorm2d(outputs, momentum=0.03)
        if relu:
            self.relu = nn.ReLU(inplace=True)


class Block(nn.Module):
    """Basic residual block (He et al. 2016)."""

    def __init__(self, width: int) -> None:
        super().__init__()
        self.first, self.second = Conv(width, width), Conv(width, width, relu=False)

    def forward(self, x: torch.Tensor) -> torch.Tensor:
        """Shape and stride stay."""
        return functional.relu(x + self.second(self.first(x)))


class Network(nn.Module):
    """(N, 1, H, W) float32 grey in -1..1, H and W multiples of 32, to (N, 20, H / 2, W / 2).

    Channels of the output: logits of background and the classes of `CLASSES`; distances to the left, top, right and
    bottom side of the voted box (logarithms of multiples of `DISTANCE_UNIT` input pixels), and the logit of the vote's
    overlap with the truth; logits of `LINKS`.
    """

    def __init__(self) -> None:
        super().__init__()
        stages = []
        last = 1
        for width, blocks in zip(_WIDTHS, _BLOCKS, strict=True):
            stages.append(nn.Sequential(Conv(last, width, stride=2), *(Block(width) for _ in range(blocks))))
            last = width
        self.stages = nn.ModuleList(stages)
        _, w4, w8, w16, w32 = _WIDTHS
        d16, d8, d4 = _DECODED
        self.context, self.surround = Conv(w32, d16, 1), Conv(w32, d16, 1)
        self.lateral16, self.merge16 = Conv(w16, d16, 1), Conv(d16, d16)
        self.reduce16, self.lateral8, self.merge8 = Conv(d16, d8, 1), Conv(w8, d8, 1), Conv(d8, d8)
        self.reduce8, self.lateral4, self.merge4 = Conv(d8, d4, 1), Conv(w4, d4, 1), Conv(d4, d4)
        self.head, self.out = Conv(d4, d4), nn.Conv2d(d4, 4 * (SHOWN + VOTED), 1)
        self.seams8, self.seams4, self.seams_voted = Conv(d8, _SEAMS, 1), Conv(w4, _SEAMS, 1), Conv(d4, _SEAMS, 1)
        self.seams, self.link = Conv(_SEAMS, _SEAMS), nn.Conv2d(_SEAMS, 4 * len(LINKS), 1)
        nn.init.normal_(self.out.weight, std=0.01)
        nn.init.normal_(self.link.weight, std=0.05)
        nn.init.constant_(self.link.bias, 1.5)
        bias = torch.zeros(SHOWN + VOTED, 4)
        bias[0], bias[SHOWN:-1] = 3.0, 1.0
        with torch.no_grad():
            self.out.bias.copy_(bias.reshape(-1))

    def forward(self, image: torch.Tensor) -> torch.Tensor:
        """Cells of a batch of images."""
        features = []
        x = image
        for stage in self.stages:
            x = stage(x)
            features.append(x)
        _, f4, f8, f16, f32 = features
        # what lies around, over some 250 input pixels, beside what lies there
        x = self.context(f32) + self.surround(functional.avg_pool2d(f32, 7, 1, 3))
        x = self.merge16(_doubled(x) + self.lateral16(f16))
        x = self.merge8(_doubled(self.reduce16(x)) + self.lateral8(f8))
        seams = _doubled(self.seams8(x)) + self.seams4(f4)
        x = self.merge4(_doubled(self.reduce8(x)) + self.lateral4(f4))
        links = self.link(self.seams(seams + self.seams_voted(x)))
        return functional.pixel_shuffle(torch.cat([self.out(self.head(x)), links], 1), 2)


def _doubled(x: torch.Tensor) -> torch.Tensor:
    return functional.interpolate(x, scale_factor=2.0, mode="nearest")
