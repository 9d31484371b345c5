"""A slow, plain-Python simulator that the compiled one must equal bit for bit.

It shares no code with `cornerforge.sim`, `cornerforge.drivers` or `cornerforge.geometry` (parameter dataclasses apart).
It is written from the stated rules, with objects, sets and full scans in place of bit masks, sorted ranks and
candidate pairs. Where a sum's rounding matters, the order of operations is that of the stated formula.
"""
