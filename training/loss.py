"""What the network is trained to: right classes, boxes that overlap the truth, and to know how well they do."""

from __future__ import annotations

import torch
from torch.nn import functional

from autowaze.vehicle.semantics.cell_links import LINKS, OUTPUT_STRIDE
from training.crops import IGNORED
from training.network import DISTANCE_UNIT, SHOWN, VOTED

_CLASS_WEIGHTS = torch.tensor([1.0, 1.0, 1.2, 1.2, 1.5])
_SEAM_WEIGHT = 1.5
_APART = (7.0, 7.0, 4.0, 4.0, 2.5, 2.5, 2.5, 2.5, 1.5, 1.5)
"""How much more a pair of cells of different instances weighs, by link: the nearer, the rarer they are."""
_RIM = 0.3
"""How much a pair weighs of which one cell is background."""


def losses(
    output: torch.Tensor,
    classes: torch.Tensor,
    boxes: torch.Tensor,
    weight: torch.Tensor,
    owner: torch.Tensor,
    bond: torch.Tensor,
) -> dict[str, torch.Tensor]:
    """Loss terms by name, each a scalar.

    Args:
        output: (N, 20, h, w) float32, of `Network`.
        classes, boxes, weight, owner, bond: targets of `crops.targets`, stacked.
    """
    return {
        "class": _class_loss(output[:, :SHOWN], classes, weight),
        **_vote_losses(output[:, SHOWN : SHOWN + VOTED], boxes, weight),
        **_link_losses(output[:, SHOWN + VOTED :], owner, classes, bond),
    }


def _class_loss(logits: torch.Tensor, classes: torch.Tensor, weight: torch.Tensor) -> torch.Tensor:
    """Cross-entropy with focus on seams and small instances, and the overlap (dice) of all vehicles together."""
    known = classes != IGNORED
    target = torch.where(known, classes, torch.zeros_like(classes)).long()
    each = functional.cross_entropy(logits, target, _CLASS_WEIGHTS.to(logits.device), reduction="none")
    inside = (target > 0).float()[:, None]
    seam = functional.max_pool2d(inside, 5, 1, 2) + functional.max_pool2d(-inside, 5, 1, 2)
    factor = known * (1.0 + _SEAM_WEIGHT * seam[:, 0]) * torch.clamp(weight, 1.0, 3.0)
    vehicle = logits.softmax(1)[:, 1] * known
    true = (target == 1).float() * known
    dice = 1 - (2 * (vehicle * true).sum() + 1) / (vehicle.sum() + true.sum() + 1)
    return (each * factor).mean() * 2.0 + 0.3 * dice


def _vote_losses(votes: torch.Tensor, boxes: torch.Tensor, weight: torch.Tensor) -> dict[str, torch.Tensor]:
    """1 - GIoU of the voted boxes (Rezatofighi et al. 2019), with their error relative to the size; and quality."""
    n, y, x = torch.nonzero(weight > 0, as_tuple=True)
    own = votes[n, :, y, x]
    true, w = boxes[n, y, x], weight[n, y, x]
    at = OUTPUT_STRIDE * torch.stack([x, y, x, y], 1) + OUTPUT_STRIDE / 2
    sign = torch.tensor([-1.0, -1.0, 1.0, 1.0], device=votes.device)
    box = at + sign * DISTANCE_UNIT * torch.exp(own[:, :4].clamp(-6, 6))
    iou, giou = _overlaps(box, true)
    size = torch.cat([true[:, 2:] - true[:, :2]] * 2, 1).clamp(min=8.0)
    relative = functional.smooth_l1_loss(box / size, true / size, beta=0.1, reduction="none").sum(1).clamp(max=3.0)
    quality = functional.binary_cross_entropy_with_logits(own[:, 4], iou.detach(), reduction="none")
    total = w.sum().clamp(min=1.0)
    return {
        "box": 1.5 * (w * (1 - giou + 0.5 * relative)).sum() / total,
        "quality": 0.5 * (w * quality).sum() / total,
    }


def _overlaps(a: torch.Tensor, b: torch.Tensor) -> tuple[torch.Tensor, torch.Tensor]:
    """IoU and GIoU (N,) of boxes (N, 4)."""
    low, high = torch.maximum(a[:, :2], b[:, :2]), torch.minimum(a[:, 2:], b[:, 2:])
    both = (high - low).clamp(min=0).prod(1)
    union = (a[:, 2:] - a[:, :2]).prod(1) + (b[:, 2:] - b[:, :2]).prod(1) - both
    hull = (torch.maximum(a[:, 2:], b[:, 2:]) - torch.minimum(a[:, :2], b[:, :2])).prod(1)
    iou = both / union.clamp(min=1e-3)
    return iou, iou - (hull - union) / hull.clamp(min=1e-3)


def _link_losses(
    logits: torch.Tensor, owner: torch.Tensor, classes: torch.Tensor, bond: torch.Tensor
) -> dict[str, torch.Tensor]:
    """Whether cells so far apart are of one instance: cross-entropy, and the overlap (dice) of what is apart."""
    h, w = owner.shape[1:]
    known = classes != IGNORED
    inside = known & (classes > 0)
    bond = bond.clamp(max=4.0)
    entropy, dice = logits.new_zeros(()), logits.new_zeros(())
    for channel, (dx, dy) in enumerate(LINKS):
        a = (slice(None), slice(0, h - dy), slice(max(-dx, 0), w - max(dx, 0)))
        b = (slice(None), slice(dy, h), slice(max(dx, 0), w + min(dx, 0)))
        logit = logits[:, channel][a]
        alike = (owner[a] == owner[b]).float()
        both = inside[a] & inside[b]
        rim = (inside[a] ^ inside[b]) & known[a] & known[b]
        importance = torch.maximum(bond[a], bond[b]) * (both + _RIM * rim)
        importance = importance * torch.where(alike > 0, 1.0, _APART[channel])
        each = functional.binary_cross_entropy_with_logits(logit, alike, reduction="none")
        entropy = entropy + (importance * each).sum() / importance.sum().clamp(min=1.0)
        plain = torch.maximum(bond[a], bond[b]) * both
        apart = torch.sigmoid(-logit) * plain
        true = (1 - alike) * plain
        dice = dice + 1 - (2 * (apart * (1 - alike)).sum() + 1) / (apart.sum() + true.sum() + 1)
    return {"link": 2.0 * entropy / len(LINKS), "seam": dice / len(LINKS)}
