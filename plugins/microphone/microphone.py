"""A microphone on the body: rotor tones, air noise, ambient noise and the microphone's own noise.

Tones at the blade-pass frequency and its harmonics, phases running on from block to block
(Tinney and Sirohi, "Multirotor Drone Noise at Static Thrust", AIAA Journal 56(7), 2018, show such
spectra). Pressure goes with the square of rotor speed, as thrust does.
"""

import math
from dataclasses import dataclass
from typing import Annotated, Any, ClassVar, Self

import numpy as np
from numpy.typing import NDArray
from pydantic import Field, model_validator

from wil_campaign.foundation.files.documents import KeyFaultError
from wil_campaign.plugins.microphone.audio import SoundLine
from wil_campaign.vehicles.readings import MicrophoneReading, Source, samples_from_pressure
from wil_campaign.vehicles.readings.faults import ReadingFault, array_fault
from wil_campaign.vehicles.readings.messages import (
    BASE64,
    INTEGER,
    STRING,
    Json,
    bytes_from_base64,
    number_from_json,
    stamped_message_schema,
)
from wil_campaign.vehicles.readings.traits import Encoded, Parts, ReadingTraits
from wil_campaign.vehicles.sensors.noise_sets import NoiseSets
from wil_campaign.vehicles.sensors.sensor_spec import SensorOptions, SensorSite, SensorSpec
from wil_campaign.vehicles.sensors.truth import Truth

REFERENCE_PA = 20.0e-6
"""0 dB of sound pressure level."""

Sound = NDArray[np.float32]


def pressure_of_level(level_db: float) -> float:
    """Return the RMS pressure in pascals of a sound pressure level at the microphone."""
    return float(REFERENCE_PA * 10.0 ** (level_db / 20.0))


@dataclass(frozen=True, slots=True)
class RotorSound:
    """The sound of the rotors at the microphone.

    hover_level_db: of all four rotors at hover_speed_rad_s: 71.5 dB(A) at 1 m (Parrot ANAFI Ai,
    technical documentation) brought to the 0.175 m between rotor and hub, 20 log10(1 / 0.175) more.
    hover_speed_rad_s: the airframe's 0.5 kg on rotors of 5.57e-6 N s^2. blades: of one rotor.
    harmonics and fall_db: how many tones, and how much quieter each is than the one before (an
    assumption within what Tinney and Sirohi show). broadband_db: noise of the air, below the tones.
    """

    hover_level_db: float = 71.5 + 15.1
    hover_speed_rad_s: float = 469.0
    blades: int = 2
    rotors: int = 4
    harmonics: int = 8
    fall_db: float = 6.0
    broadband_db: float = -10.0


@dataclass(frozen=True, slots=True)
class MicrophoneNoise:
    """The microphone's white noise beside the rotors, and its full scale.

    Self noise and full scale: TDK InvenSense ICS-43434 data sheet (DS-000069): 65 dB(A) below
    94 dB; 0 dBFS at 120 dB, the peak of a sine. ambient_level_db: a quiet hall, an assumption.
    """

    ambient_level_db: float = 40.0
    self_noise_db: float = 94.0 - 65.0
    full_scale_pa: float = pressure_of_level(120.0) * math.sqrt(2.0)


QUIET = MicrophoneNoise(ambient_level_db=-math.inf, self_noise_db=-math.inf)
MICROPHONE_NOISES = NoiseSets(ideal=QUIET, datasheet=MicrophoneNoise())


class MicrophoneSensor:
    """A microphone sensor of blocks of sound; keeps its count and the rotors' angles."""

    def __init__(
        self,
        *,
        source: Source,
        rotors: RotorSound | None = None,
        noise: MicrophoneNoise | None = None,
        sample_rate_hz: int = 16_000,
        block_samples: int = 512,
        latency_s: float = 0.0,
    ) -> None:
        self._source = source
        self._rotors = rotors or RotorSound()
        self._noise = noise or QUIET
        self._rate_hz = sample_rate_hz
        self._block = block_samples
        self._latency_s = latency_s
        self._steps = (np.arange(block_samples) + 1.0) / block_samples
        self._weights = _tone_weights(self._rotors)
        self._angles = np.zeros(0)
        self._speeds = np.zeros(0)
        self._seq = 0

    @property
    def block_s(self) -> float:
        """Return the length of a microphone's block: the period of sample()."""
        return self._block / self._rate_hz

    def sample(self, truth: Truth, t_s: float, rng: np.random.Generator) -> MicrophoneReading:
        """Return the microphone's block that ends at t_s; rotor speeds change within."""
        pressure = self._rotor_pressure(np.array(truth.motor_speeds_rad_s), rng)
        around = math.hypot(
            pressure_of_level(self._noise.ambient_level_db),
            pressure_of_level(self._noise.self_noise_db),
        )
        if around > 0.0:
            pressure += np.float32(around) * rng.standard_normal(self._block, dtype=np.float32)
        self._seq += 1
        return MicrophoneReading(
            t_s=t_s - self.block_s,
            arrived_s=t_s + self._latency_s,
            seq=self._seq - 1,
            source=self._source,
            samples=samples_from_pressure(pressure, self._noise.full_scale_pa),
            sample_rate_hz=self._rate_hz,
            full_scale_pa=self._noise.full_scale_pa,
        )

    def _rotor_pressure(self, speeds: NDArray[np.float64], rng: np.random.Generator) -> Sound:
        """Return (block,) pascals of all rotors at the microphone."""
        if len(speeds) == 0:
            return np.zeros(self._block, np.float32)
        if len(self._speeds) != len(speeds):
            self._speeds = speeds
            self._angles = rng.uniform(0.0, 2.0 * math.pi, len(speeds))
        before, gain = self._speeds[:, None], (speeds - self._speeds)[:, None]
        turned = self.block_s * (before * self._steps + 0.5 * gain * self._steps**2)
        angles = self._angles[:, None] + turned
        loudness = ((before + gain * self._steps) / self._rotors.hover_speed_rad_s) ** 2
        self._angles = angles[:, -1] % (2.0 * math.pi)
        self._speeds = speeds
        tones = self._tones(angles, speeds)
        air = pressure_of_level(self._rotors.hover_level_db + self._rotors.broadband_db)
        hiss = rng.standard_normal(self._block, dtype=np.float32)
        mean = loudness.mean(axis=0).astype(np.float32)
        pressure: Sound = (loudness * tones).sum(axis=0).astype(np.float32)
        pressure += np.float32(air) * mean * hiss
        return pressure

    def _tones(self, angles: NDArray[np.float64], speeds: NDArray[np.float64]) -> Sound:
        """Return (rotors, block) pascals at hover loudness; aliases are left out."""
        base = np.exp(1j * self._rotors.blades * angles).astype(np.complex64)
        fundamental_hz = self._rotors.blades * speeds / (2.0 * math.pi)
        tones, turning = np.zeros(angles.shape, np.float32), base.copy()
        for harmonic, weight in enumerate(self._weights, start=1):
            audible = harmonic * fundamental_hz < self._rate_hz / 2.0
            tones += (weight * audible).astype(np.float32)[:, None] * turning.imag
            turning *= base
        return tones


def _tone_weights(sound: RotorSound) -> tuple[float, ...]:
    """Return the amplitude (Pa) of each harmonic of a rotor at the microphone, loudest first."""
    relative = [10.0 ** (-sound.fall_db * h / 20.0) for h in range(sound.harmonics)]
    power = sum(weight * weight for weight in relative) * sound.rotors / 2.0
    scale = pressure_of_level(sound.hover_level_db) / math.sqrt(power)
    return tuple(scale * weight for weight in relative)


class MicrophoneOptions(SensorOptions):
    """A microphone sensor that delivers blocks of samples.

    sample_rate_hz: samples in a second. block_samples: samples of each reading.
    """

    embedded_only: ClassVar[bool] = True
    sample_rate_hz: Annotated[int, Field(ge=1000, le=192_000)] = 16_000
    block_samples: Annotated[int, Field(ge=16, le=65_536)] = 512

    @model_validator(mode="after")
    def _limit_rate(self) -> Self:
        """Refuse a microphone sensor of more than 250 blocks per second."""
        if self.per_s > 250.0:
            raise KeyFaultError("block_samples", f"gives {self.per_s:g} blocks/s; at most 250")
        return self

    @property
    def per_s(self) -> float:
        """Return the microphone's blocks per second."""
        return self.sample_rate_hz / self.block_samples


def _model(options: MicrophoneOptions, site: SensorSite) -> MicrophoneSensor:
    return MicrophoneSensor(
        source=site.side,
        noise=MICROPHONE_NOISES.named(site.noise),
        sample_rate_hz=options.sample_rate_hz,
        block_samples=options.block_samples,
    )


def _fault(reading: MicrophoneReading) -> ReadingFault | None:
    """Check a microphone reading; return its fault or None."""
    fault = array_fault(reading.samples, (None,), np.int16, "sound")
    if fault is not None:
        return fault
    if len(reading.samples) == 0:
        return ReadingFault("empty", "the block of sound has no samples")
    if reading.sample_rate_hz < 1 or not 0.0 < reading.full_scale_pa < math.inf:
        scale = f"{reading.sample_rate_hz} Hz, full scale {reading.full_scale_pa} Pa"
        return ReadingFault("out_of_range", f"sound at {scale}")
    return None


def _encode(reading: MicrophoneReading) -> Encoded:
    """Return a block of sound as the fields of a foxglove.RawAudio."""
    fields = {
        "format": "pcm-s16",
        "sample_rate": reading.sample_rate_hz,
        "number_of_channels": 1,
        "wil": {"full_scale_pa": reading.full_scale_pa},
    }
    return fields, reading.samples.astype("<i2").tobytes()


def _decode(document: Json, _: Parts) -> dict[str, Any]:
    return {
        "samples": np.frombuffer(bytes_from_base64(document["data"]), "<i2"),
        "sample_rate_hz": document["sample_rate"],
        "full_scale_pa": number_from_json(document["wil"]["full_scale_pa"]),
    }


def _rms_pa(reading: MicrophoneReading) -> float:
    """Return the RMS sound pressure of a microphone reading."""
    return float(np.sqrt(np.mean(np.square(reading.pressure_pa, dtype=np.float64))))


_TRAITS = ReadingTraits(
    fault=_fault,
    schema=stamped_message_schema(
        "foxglove.RawAudio",
        data=BASE64,
        format=STRING,
        sample_rate=INTEGER,
        number_of_channels=INTEGER,
    ),
    encode=_encode,
    decode=_decode,
    compared=lambda r: (r.samples.tobytes(),) if bool(r.samples.any()) else (),
    has_moved=lambda reading, since, now: True,  # noqa: ARG005 - no two blocks of sound are equal
    elements="samples",
    line=lambda: SoundLine(is_steady=True),
    quantities={"loudness_pa": _rms_pa},
)
MICROPHONE = SensorSpec("microphone", MicrophoneReading, MicrophoneOptions, _model, traits=_TRAITS)
