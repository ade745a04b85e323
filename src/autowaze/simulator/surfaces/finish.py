"""What the alpha channel of an opaque texture says about a texel.

The values lie close together so that a blend of dark trim and white, tintable paint turns tintable early: an untinted
light seam would show round every window of a dark car.
"""

from __future__ import annotations

MATTE = 110
"""Colour as painted."""
GLASS = 140
"""Dark and mirroring."""
TINTED = 255
"""Multiplied by the colour of the object: car paint, plaster, cloth."""
