"""What the walker hears in words, in every language, in one place.

Short: the walker acts only once a sentence has been heard. "Move" rather than "walk" (Wayfindr).
"""

from __future__ import annotations

from typing import Literal

from navcore.types import Reason

Language = Literal["en", "zh"]

STOP_TEXTS: dict[Language, dict[Reason, str]] = {
    "en": {
        Reason.OK: "Stop.",
        Reason.OFF_ROAD: "Stop. Off the road.",
        Reason.OBSTACLE_DEPTH: "Stop. Obstacle ahead.",
        Reason.OBSTACLE_SONAR: "Stop. Something ahead that the camera does not see.",
        Reason.DROP_AHEAD: "Stop! The floor drops ahead.",
        Reason.NO_CANDIDATE: "Stop. No free way in view.",
        Reason.DEPTH_INVALID: "Stop. The camera cannot see.",
        Reason.POSE_LOST: "Stop. Position lost.",
        Reason.SENSOR_STALE: "Stop. A sensor has failed.",
        Reason.ARRIVED: "You have arrived.",
        Reason.NO_ROUTE: "Stop. No destination.",
        Reason.PAUSED: "Stop. Paused.",
    },
    "zh": {
        Reason.OK: "停。",
        Reason.OFF_ROAD: "停。已偏离路线。",
        Reason.OBSTACLE_DEPTH: "停。前方有障碍物。",
        Reason.OBSTACLE_SONAR: "停。前方有摄像头看不见的障碍物。",
        Reason.DROP_AHEAD: "停!前方地面下降。",
        Reason.NO_CANDIDATE: "停。视野内没有可走的方向。",
        Reason.DEPTH_INVALID: "停。摄像头看不清。",
        Reason.POSE_LOST: "停。位置丢失。",
        Reason.SENSOR_STALE: "停。传感器失灵。",
        Reason.ARRIVED: "您已到达。",
        Reason.NO_ROUTE: "停。没有目的地。",
        Reason.PAUSED: "停。已暂停。",
    },
}

TEXTS: dict[Language, dict[str, str]] = {
    "en": {
        "turn_left": "Turn left {degrees} degrees.",
        "turn_right": "Turn right {degrees} degrees.",
        "turn_round_left": "Turn around to the left.",
        "turn_round_right": "Turn around to the right.",
        "move_straight": "Move forward.",
        "move_left": "Move {degrees} degrees left.",
        "move_right": "Move {degrees} degrees right.",
        "off_road": "Off the road.",
        "poi_ahead": "{name} in {metres} metres.",
        "reassurance": "On the way. {metres} metres to go.",
        "arrived": "You have arrived: {name}.",
        "sonar_lost": "Ultrasonic sensor failed. Depth camera only.",
        "sonar_back": "Ultrasonic sensor works again.",
        "pose_uncertain": "Position uncertain.",
        "way_closed": "The way ahead has been closed.",
        "way_blocked": "The way is blocked. Another way: {metres} metres.",
        "way_blocked_wait": "The way is blocked, and there is no other. Wait, or ask for help.",
        "way_anew": "Off the road. New way: {metres} metres.",
    },
    "zh": {
        "turn_left": "向左转{degrees}度。",
        "turn_right": "向右转{degrees}度。",
        "turn_round_left": "向左转身。",
        "turn_round_right": "向右转身。",
        "move_straight": "向前走。",
        "move_left": "向左{degrees}度走。",
        "move_right": "向右{degrees}度走。",
        "off_road": "已偏离路线。",
        "poi_ahead": "前方{metres}米,{name}。",
        "reassurance": "路线正确,还有{metres}米。",
        "arrived": "您已到达{name}。",
        "sonar_lost": "超声波传感器失灵,仅用深度摄像头。",
        "sonar_back": "超声波传感器已恢复。",
        "pose_uncertain": "位置不确定。",
        "way_closed": "前方道路已关闭。",
        "way_blocked": "道路被阻挡。改走另一条路,{metres}米。",
        "way_blocked_wait": "道路被阻挡,没有其他路。请等候或求助。",
        "way_anew": "已偏离路线。新路线{metres}米。",
    },
}

_SPEECH_START_S = 0.25
_S_PER_CHARACTER: dict[Language, float] = {"en": 0.066, "zh": 0.22}
_ROUND_TURN_DEG = 155.0


def stop_text(reason: Reason, language: Language) -> str:
    """Return what is said with a stop."""
    return STOP_TEXTS[language][reason]


def turn_text(angle_deg: float, language: Language) -> str:
    """Return the words of a turn on the spot; left is positive."""
    side = "left" if angle_deg > 0 else "right"
    key = f"turn_round_{side}" if abs(angle_deg) >= _ROUND_TURN_DEG else f"turn_{side}"
    return TEXTS[language][key].format(degrees=round(abs(angle_deg)))


def move_text(angle_deg: float, straight_within_deg: float, language: Language) -> str:
    """Return the words that begin a movement in a direction; left is positive."""
    if abs(angle_deg) <= straight_within_deg:
        return TEXTS[language]["move_straight"]
    return TEXTS[language]["move_left" if angle_deg > 0 else "move_right"].format(degrees=round(abs(angle_deg)))


def speech_duration_s(text: str, language: Language) -> float:
    """Return about how long a text takes to be spoken, seconds; 0 for no text."""
    return _SPEECH_START_S + _S_PER_CHARACTER[language] * len(text) if text else 0.0
