"""A MAVLink camera component for mixed images, so that a ground station finds them; pure.

Camera protocol v2: https://mavlink.io/en/services/camera.html. A ground station receives the
heartbeat of a camera, requests CAMERA_INFORMATION, whose flags announce video, then requests
VIDEO_STREAM_INFORMATION and plays its URI. Both kinds of request are answered: REQUEST_MESSAGE, and
the older commands 521 and 2504 that released ground stations still send.
"""

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from wil_campaign.worlds.camera import Intrinsics

HEARTBEAT_PERIOD_S = 1.0
_ALL = 0


@dataclass(frozen=True, slots=True)
class VideoStream:
    """A video stream of the camera component that a ground station may play.

    port: UDP port of RTP, the whole URI that the protocol wants for RTP over UDP. bit_rate:
    bits per second, 0 when unknown.
    """

    port: int = 5600
    rate_hz: float = 15.0
    bit_rate: int = 0
    name: str = "mixed"


class CameraComponent:
    """A MAVLink camera component: messages in, messages out, as pymavlink objects.

    The caller packs its messages with system_id and component_id. system_id: of the vehicle that
    carries the camera. start_s: boot time of the component, run clock.
    """

    def __init__(
        self,
        *,
        system_id: int,
        intrinsics: Intrinsics,
        stream: VideoStream,
        component_id: int = mavlink.MAV_COMP_ID_CAMERA,
        model: str = "mixed picture",
        start_s: float = 0.0,
    ) -> None:
        self.system_id = system_id
        self.component_id = component_id
        self._intrinsics = intrinsics
        self._stream = stream
        self._model = model
        self._start_s = start_s
        self._heartbeat_due_s = start_s
        self._messages: Mapping[int, Callable[[float], Any]] = {
            mavlink.MAVLINK_MSG_ID_CAMERA_INFORMATION: self._information,
            mavlink.MAVLINK_MSG_ID_VIDEO_STREAM_INFORMATION: self._stream_information,
            mavlink.MAVLINK_MSG_ID_VIDEO_STREAM_STATUS: self._stream_status,
            mavlink.MAVLINK_MSG_ID_CAMERA_SETTINGS: self._settings,
            mavlink.MAVLINK_MSG_ID_CAMERA_CAPTURE_STATUS: self._capture_status,
            mavlink.MAVLINK_MSG_ID_HEARTBEAT: lambda _t_s: _heartbeat(),
        }

    def tick(self, t_s: float) -> list[Any]:
        """Return the camera component's due messages: a heartbeat a second."""
        if t_s < self._heartbeat_due_s:
            return []
        is_late = t_s - self._heartbeat_due_s >= HEARTBEAT_PERIOD_S
        self._heartbeat_due_s = (t_s if is_late else self._heartbeat_due_s) + HEARTBEAT_PERIOD_S
        return [_heartbeat()]

    def receive(self, message: Any, t_s: float) -> list[Any]:
        """Return the camera component's replies to a message; none for other targets."""
        if message.get_type() not in {"COMMAND_LONG", "COMMAND_INT"}:
            return []
        if message.target_system not in {_ALL, self.system_id}:
            return []
        if message.target_component not in {_ALL, self.component_id}:
            return []
        return self._command(message, t_s)

    def _command(self, message: Any, t_s: float) -> list[Any]:
        command = message.command
        if command == mavlink.MAV_CMD_REQUEST_MESSAGE:
            wanted = _whole(message.param1)
            return self._answer_request(message, wanted, t_s, stream=_whole(message.param2))
        if command in _OLDER_REQUESTS:
            stream = _whole(message.param1) if command in _STREAM_REQUESTS else _ALL
            return self._answer_request(message, _OLDER_REQUESTS[command], t_s, stream=stream)
        if command in _ACCEPTED:
            return [self._ack(message, mavlink.MAV_RESULT_ACCEPTED)]
        return self._refuse_command(message)

    def _answer_request(self, message: Any, wanted: int, t_s: float, *, stream: int) -> list[Any]:
        answer = self._messages.get(wanted)
        if answer is None:
            return self._refuse_command(message)
        if wanted in _OF_STREAMS and stream not in {_ALL, 1}:
            return [self._ack(message, mavlink.MAV_RESULT_DENIED)]
        return [self._ack(message, mavlink.MAV_RESULT_ACCEPTED), answer(t_s)]

    def _refuse_command(self, message: Any) -> list[Any]:
        # The autopilot refuses a broadcast command: a second refusal would confuse its sender.
        if message.target_component == _ALL:
            return []
        return [self._ack(message, mavlink.MAV_RESULT_UNSUPPORTED)]

    def _ack(self, message: Any, result: int) -> Any:
        return mavlink.MAVLink_command_ack_message(
            message.command,
            result,
            target_system=message.get_srcSystem(),
            target_component=message.get_srcComponent(),
        )

    def _boot_ms(self, t_s: float) -> int:
        return max(0, round((t_s - self._start_s) * 1000.0)) & 0xFFFFFFFF

    def _information(self, t_s: float) -> Any:
        i = self._intrinsics
        return mavlink.MAVLink_camera_information_message(
            self._boot_ms(t_s),
            _text_bytes("wil-campaign", 32),
            _text_bytes(self._model, 32),
            firmware_version=1,
            focal_length=math.nan,
            sensor_size_h=math.nan,
            sensor_size_v=math.nan,
            resolution_h=i.width_px,
            resolution_v=i.height_px,
            lens_id=0,
            flags=mavlink.CAMERA_CAP_FLAGS_HAS_VIDEO_STREAM,
            cam_definition_version=0,
            cam_definition_uri=b"",
        )

    def _stream_information(self, _t_s: float) -> Any:
        i, stream = self._intrinsics, self._stream
        return mavlink.MAVLink_video_stream_information_message(
            stream_id=1,
            count=1,
            type=mavlink.VIDEO_STREAM_TYPE_RTPUDP,
            flags=mavlink.VIDEO_STREAM_STATUS_FLAGS_RUNNING,
            framerate=stream.rate_hz,
            resolution_h=i.width_px & ~1,
            resolution_v=i.height_px & ~1,
            bitrate=stream.bit_rate,
            rotation=0,
            hfov=self._hfov_deg(),
            name=stream.name.encode()[:31],
            uri=str(stream.port).encode(),
            encoding=mavlink.VIDEO_STREAM_ENCODING_H264,
        )

    def _stream_status(self, _t_s: float) -> Any:
        i, stream = self._intrinsics, self._stream
        return mavlink.MAVLink_video_stream_status_message(
            stream_id=1,
            flags=mavlink.VIDEO_STREAM_STATUS_FLAGS_RUNNING,
            framerate=stream.rate_hz,
            resolution_h=i.width_px & ~1,
            resolution_v=i.height_px & ~1,
            bitrate=stream.bit_rate,
            rotation=0,
            hfov=self._hfov_deg(),
        )

    def _settings(self, t_s: float) -> Any:
        return mavlink.MAVLink_camera_settings_message(
            self._boot_ms(t_s), mavlink.CAMERA_MODE_VIDEO
        )

    def _capture_status(self, t_s: float) -> Any:
        return mavlink.MAVLink_camera_capture_status_message(
            self._boot_ms(t_s),
            image_status=0,
            video_status=0,
            image_interval=0.0,
            recording_time_ms=0,
            available_capacity=0.0,
        )

    def _hfov_deg(self) -> int:
        i = self._intrinsics
        return round(math.degrees(2.0 * math.atan(i.width_px / 2.0 / i.fx_px)))


_OLDER_REQUESTS: Mapping[int, int] = {
    mavlink.MAV_CMD_REQUEST_CAMERA_INFORMATION: mavlink.MAVLINK_MSG_ID_CAMERA_INFORMATION,
    mavlink.MAV_CMD_REQUEST_CAMERA_SETTINGS: mavlink.MAVLINK_MSG_ID_CAMERA_SETTINGS,
    mavlink.MAV_CMD_REQUEST_CAMERA_CAPTURE_STATUS: mavlink.MAVLINK_MSG_ID_CAMERA_CAPTURE_STATUS,
    mavlink.MAV_CMD_REQUEST_VIDEO_STREAM_INFORMATION: (
        mavlink.MAVLINK_MSG_ID_VIDEO_STREAM_INFORMATION
    ),
    mavlink.MAV_CMD_REQUEST_VIDEO_STREAM_STATUS: mavlink.MAVLINK_MSG_ID_VIDEO_STREAM_STATUS,
}
_STREAM_REQUESTS = frozenset(
    {
        mavlink.MAV_CMD_REQUEST_VIDEO_STREAM_INFORMATION,
        mavlink.MAV_CMD_REQUEST_VIDEO_STREAM_STATUS,
    }
)
_OF_STREAMS = frozenset(
    {
        mavlink.MAVLINK_MSG_ID_VIDEO_STREAM_INFORMATION,
        mavlink.MAVLINK_MSG_ID_VIDEO_STREAM_STATUS,
    }
)
_ACCEPTED = frozenset({mavlink.MAV_CMD_VIDEO_START_STREAMING})
"""The stream runs as long as the run: starting it has no effect."""


def _heartbeat() -> Any:
    return mavlink.MAVLink_heartbeat_message(
        mavlink.MAV_TYPE_CAMERA,
        mavlink.MAV_AUTOPILOT_INVALID,
        0,
        0,
        mavlink.MAV_STATE_ACTIVE,
        3,
    )


def _text_bytes(text: str, length: int) -> list[int]:
    """Return a text as a fixed-length field of a camera message."""
    raw = text.encode()[: length - 1]
    return list(raw.ljust(length, b"\0"))


def _whole(number: float) -> int:
    """Return a camera message's number as an integer; -1 when not finite."""
    return int(number) if math.isfinite(number) else -1
