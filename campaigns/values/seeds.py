"""Seeds of runs: from the campaign's seed, the case and the repetition, and not from the mode.

So the same repetition has the same random numbers in modes sim and wil: modes are paired.
"""

import hashlib

import numpy as np


def run_seed(seed: int, case: str, repetition: int) -> int:
    """Return the seed of a run, below 2**53 so that every JSON reader keeps it exactly.

    NumPy's SeedSequence mixes the campaign's seed, the first 16 bytes of SHA-256 of the case's
    name, and the repetition (from 1); it does not depend on the platform or on hash order.
    """
    digest = hashlib.sha256(case.encode()).digest()[:16]
    mixed = np.random.SeedSequence([seed, int.from_bytes(digest, "big"), repetition])
    return int(mixed.generate_state(1, np.uint64)[0]) >> 11
