"""What the walker hears in words, in every language, in one place.

Short: the walker acts only once a sentence has been heard. "Move" rather than "walk" (Wayfindr). How a direction is put
into words is chosen in :mod:`navcore.cues.directions`.
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
        Reason.CAMERA_MOVED: "Stop. The camera has moved.",
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
        Reason.CAMERA_MOVED: "停。摄像头移位了。",
        Reason.ARRIVED: "您已到达。",
        Reason.NO_ROUTE: "停。没有目的地。",
        Reason.PAUSED: "停。已暂停。",
    },
}

EXPLANATIONS: dict[Language, dict[Reason, str]] = {
    "en": {
        Reason.OK: "Guidance has failed. Stand still: it goes on by itself when it can.",
        Reason.OFF_ROAD: "You have left the road. Guidance leads back to it.",
        Reason.OBSTACLE_DEPTH: "The camera sees something in the way. Guidance looks for a way round it.",
        Reason.OBSTACLE_SONAR: "The ultrasonic sensor hears something that the camera cannot see, perhaps glass.",
        Reason.DROP_AHEAD: "The floor falls away in front of you, perhaps a stair. Do not step forward.",
        Reason.NO_CANDIDATE: "No direction in view is free and wide enough. Wait, or ask for help.",
        Reason.DEPTH_INVALID: "The camera sees too little to be trusted. It may be covered, or it is too dark.",
        Reason.POSE_LOST: "The device does not recognise this place. Stand still: it goes on by itself when it does.",
        Reason.SENSOR_STALE: "A sensor gives nothing new. Stand still: guidance goes on by itself when it does.",
        Reason.CAMERA_MOVED: "The camera does not see the floor as it did when it was set up. Stand still, hold your"
        " head level, and straighten the glasses; or have the camera calibrated again.",
        Reason.ARRIVED: "The destination is reached. Guidance has ended.",
        Reason.NO_ROUTE: "No destination is chosen, or no way leads there.",
        Reason.PAUSED: "Guidance waits until it is resumed.",
    },
    "zh": {
        Reason.OK: "导航出错。请站住,恢复后会自动继续。",
        Reason.OFF_ROAD: "您已离开道路,导航将带您回到路上。",
        Reason.OBSTACLE_DEPTH: "摄像头看到前面有东西挡路,正在寻找绕行方向。",
        Reason.OBSTACLE_SONAR: "超声波探测到摄像头看不见的东西,可能是玻璃。",
        Reason.DROP_AHEAD: "您前面的地面下降,可能是楼梯。请不要向前迈步。",
        Reason.NO_CANDIDATE: "视野内没有足够宽的通路。请等候或求助。",
        Reason.DEPTH_INVALID: "摄像头看到的太少,不可信。可能被遮住,或光线太暗。",
        Reason.POSE_LOST: "设备认不出这个地方。请站住,认出后会自动继续。",
        Reason.SENSOR_STALE: "传感器没有新的数据。请站住,恢复后会自动继续。",
        Reason.CAMERA_MOVED: "摄像头看到的地面与校准时不同。请站住,抬正头部,扶正眼镜;或请人重新校准。",
        Reason.ARRIVED: "目的地已到,导航结束。",
        Reason.NO_ROUTE: "没有选择目的地,或没有路通往那里。",
        Reason.PAUSED: "导航已暂停,等待继续。",
    },
}
"""Said after a stop where the walker wants to hear everything; never instead of it. No word of it is an instruction to
move: whoever listens with half an ear must not hear one."""

TEXTS: dict[Language, dict[str, str]] = {
    "en": {
        "turn_left": "Turn left {degrees} degrees.",
        "turn_right": "Turn right {degrees} degrees.",
        "turn_clock": "Turn to {hour} o'clock.",
        "turn_slightly_left": "Turn slightly left.",
        "turn_slightly_right": "Turn slightly right.",
        "turn_half_left": "Turn half left.",
        "turn_half_right": "Turn half right.",
        "turn_full_left": "Turn left.",
        "turn_full_right": "Turn right.",
        "turn_sharp_left": "Turn sharp left.",
        "turn_sharp_right": "Turn sharp right.",
        "turn_round_left": "Turn around to the left.",
        "turn_round_right": "Turn around to the right.",
        "move_straight": "Move forward.",
        "move_left": "Move {degrees} degrees left.",
        "move_right": "Move {degrees} degrees right.",
        "move_clock": "Move towards {hour} o'clock.",
        "move_slightly_left": "Move slightly left.",
        "move_slightly_right": "Move slightly right.",
        "move_half_left": "Move half left.",
        "move_half_right": "Move half right.",
        "move_full_left": "Move left.",
        "move_full_right": "Move right.",
        "move_sharp_left": "Move sharp left.",
        "move_sharp_right": "Move sharp right.",
        "move_round_left": "Move back, round to the left.",
        "move_round_right": "Move back, round to the right.",
        "off_road": "Off the road.",
        "turn_ahead_left": "In {distance} turn left.",
        "turn_ahead_right": "In {distance} turn right.",
        "turn_ahead_exact": "In {distance}: {turn}",
        "poi_ahead": "{name} in {distance}.",
        "poi_ahead_kind": "{kind} in {distance}: {name}.",
        "hazard_ahead": "Caution, {kind} in {distance}: {name}.",
        "hazard_ahead_named": "Caution, {name} in {distance}.",
        "deviation_left": "The road is {distance} to your left.",
        "deviation_right": "The road is {distance} to your right.",
        "reassurance": "On the way. {distance} to go.",
        "arrived": "You have arrived: {name}.",
        "arrived_here": "You have arrived.",
        "sonar_lost": "Ultrasonic sensor failed. Depth camera only.",
        "sonar_back": "Ultrasonic sensor works again.",
        "pose_uncertain": "Position uncertain.",
        "way_closed": "The way ahead has been closed.",
        "way_blocked": "The way is blocked. Another way: {metres} metres.",
        "way_blocked_wait": "The way is blocked, and there is no other. Wait, or ask for help.",
        "way_anew": "Off the road. New way: {metres} metres.",
        "camera_moved": "The camera has moved. Hold your head level and straighten the glasses.",
        "camera_agrees": "The camera sees the floor as it should again.",
        "mode_off_duty": "Off duty.",
        "mode_mapping": "A map is being recorded.",
        "mode_localizing": "Looking for your position.",
        "mode_no_map": "There is no map yet. Wait while one is built, or hold the main button twice to record one.",
        "mode_ready": "Ready.",
        "mode_guiding": "On the way to {name}.",
        "mode_paused": "Paused, on the way to {name}.",
        "mode_lost": "Position lost.",
        "mode_arrived": "You are at {name}.",
        "mode_fault": "Something has failed.",
        "on_duty": "On duty. Looking for your position.",
        "off_duty": "Off duty.",
        "map_offered": "Does a sighted person want to record a map? Press next to begin.",
        "map_begun": "The map walk begins.",
        "map_place": "Place {number}",
        "map_marked": "Place {number} is marked.",
        "map_ended": "The map walk has ended.",
        "map_walk_covered": "The camera is covered. Uncover it.",
        "map_walk_dark": "Too dark. Turn on the light.",
        "map_walk_lost": "Place lost. Go back a few steps, to where it was still known.",
        "map_walk_slow_down": "Slow down.",
        "map_walk_look_ahead": "Look ahead.",
        "map_walk_weak": "This stretch is weak. Look at doors, signs and corners.",
        "map_walk_found": "Place found again. Go on.",
        "map_walk_loop": "Good: the loop is closed.",
        "map_none": "There is no map yet. Hold the main button to record one.",
        "map_no_picture": "The camera gives no pictures. Nothing is recorded.",
        "map_picture": "The camera works again.",
        "map_disk_full": "The disk is full. The map walk has ended.",
        "map_disk_slow": "The disk is too slow. Stand still for a moment.",
        "map_not_recorded": "The map walk cannot be recorded. It has ended.",
        "map_no_feedback": "The walk is recorded, but no advice can be given any more.",
        "map_recorded": "Recorded. Places: {places}. The map is being built.",
        "map_handed_over": "Recorded. Places: {places}. The map is built at the console's machine.",
        "map_building": "Building the map: {percent} percent.",
        "map_not_built": "The map could not be built. The old one stays. The recording is kept.",
        "map_too_short": "Too little was walked for a map. The old one stays. The recording is kept.",
        "map_unfinished": "A map walk was broken off. Its map is being built.",
        "map_built": "The new map is in use. Road: {metres} metres. Places: {places}. Loops: {loops}.",
        "map_built_good": "No weak stretch.",
        "map_built_weak": "Weak stretches: {count}. The longest: {metres} metres, {from_m} metres from the beginning.",
        "destination": "To {name}.",
        "destination_console": "The console leads you to {name}.",
        "refused_off_duty": "You are off duty. Press the main button to go on duty.",
        "refused_on_duty": "You are on duty already.",
        "refused_no_map": "There is no map yet. Hold the main button to record one, or have one sent by the console.",
        "refused_mapping": "A map is being recorded. Hold the main button to end it.",
        "refused_no_map_walk": "No map is being recorded.",
        "refused_not_led": "You are not being led.",
        "refused_led": "You are being led. Stop that first.",
        "refused_paused": "Guidance is paused already.",
        "refused_not_paused": "Guidance is not paused.",
        "menu_by_distance": "Places by distance.",
        "menu_by_name": "Places by name.",
        "menu_entry": "{name}, {distance}. {number} of {count}.",
        "menu_entry_here": "{name}, here. {number} of {count}.",
        "menu_entry_unknown": "{name}. {number} of {count}.",
        "menu_closed": "List closed.",
        "menu_empty": "There is no place to go to.",
        "where_here": "You are at {name}.",
        "where_near": "{name}: {distance}, {direction}.",
        "where_goal": "To {name}: {distance}.",
        "where_next": "On the way: {name} in {distance}.",
        "where_unknown": "Your position is not known.",
        "where_last": "{seconds} seconds ago you were {distance} from {name}.",
        "where_no_place": "Your position is known, but no place has a name.",
        "at_ahead": "straight ahead",
        "at_behind": "behind you",
        "at_degrees_left": "{degrees} degrees to the left",
        "at_degrees_right": "{degrees} degrees to the right",
        "at_clock": "at {hour} o'clock",
        "at_half_left": "half left",
        "at_half_right": "half right",
        "at_full_left": "on the left",
        "at_full_right": "on the right",
        "at_sharp_left": "behind on the left",
        "at_sharp_right": "behind on the right",
    },
    "zh": {
        "turn_left": "向左转{degrees}度。",
        "turn_right": "向右转{degrees}度。",
        "turn_clock": "转向{hour}点钟方向。",
        "turn_slightly_left": "稍向左转。",
        "turn_slightly_right": "稍向右转。",
        "turn_half_left": "向左前方转。",
        "turn_half_right": "向右前方转。",
        "turn_full_left": "向左转。",
        "turn_full_right": "向右转。",
        "turn_sharp_left": "向左后方转。",
        "turn_sharp_right": "向右后方转。",
        "turn_round_left": "向左转身。",
        "turn_round_right": "向右转身。",
        "move_straight": "向前走。",
        "move_left": "向左{degrees}度走。",
        "move_right": "向右{degrees}度走。",
        "move_clock": "向{hour}点钟方向走。",
        "move_slightly_left": "稍向左走。",
        "move_slightly_right": "稍向右走。",
        "move_half_left": "向左前方走。",
        "move_half_right": "向右前方走。",
        "move_full_left": "向左走。",
        "move_full_right": "向右走。",
        "move_sharp_left": "向左后方走。",
        "move_sharp_right": "向右后方走。",
        "move_round_left": "从左边往回走。",
        "move_round_right": "从右边往回走。",
        "off_road": "已偏离路线。",
        "turn_ahead_left": "{distance}后左转。",
        "turn_ahead_right": "{distance}后右转。",
        "turn_ahead_exact": "{distance}后,{turn}",
        "poi_ahead": "前方{distance},{name}。",
        "poi_ahead_kind": "前方{distance},{kind}:{name}。",
        "hazard_ahead": "注意,前方{distance}有{kind}:{name}。",
        "hazard_ahead_named": "注意,前方{distance},{name}。",
        "deviation_left": "道路在您左边{distance}。",
        "deviation_right": "道路在您右边{distance}。",
        "reassurance": "路线正确,还有{distance}。",
        "arrived": "您已到达{name}。",
        "arrived_here": "您已到达。",
        "sonar_lost": "超声波传感器失灵,仅用深度摄像头。",
        "sonar_back": "超声波传感器已恢复。",
        "pose_uncertain": "位置不确定。",
        "way_closed": "前方道路已关闭。",
        "way_blocked": "道路被阻挡。改走另一条路,{metres}米。",
        "way_blocked_wait": "道路被阻挡,没有其他路。请等候或求助。",
        "way_anew": "已偏离路线。新路线{metres}米。",
        "camera_moved": "摄像头移位了。请抬正头部,扶正眼镜。",
        "camera_agrees": "摄像头看到的地面恢复正常。",
        "mode_off_duty": "已停用。",
        "mode_mapping": "正在录制地图。",
        "mode_localizing": "正在寻找您的位置。",
        "mode_no_map": "还没有地图。请等待地图生成,或按住主键两次来录制。",
        "mode_ready": "准备就绪。",
        "mode_guiding": "正在前往{name}。",
        "mode_paused": "已暂停,目的地是{name}。",
        "mode_lost": "位置丢失。",
        "mode_arrived": "您在{name}。",
        "mode_fault": "设备出现故障。",
        "on_duty": "已启用,正在寻找您的位置。",
        "off_duty": "已停用。",
        "map_offered": "由视力正常的人录制地图吗?按下一个键开始。",
        "map_begun": "开始录制地图。",
        "map_place": "地点{number}",
        "map_marked": "已标记地点{number}。",
        "map_ended": "地图录制结束。",
        "map_walk_covered": "摄像头被遮住了,请移开遮挡物。",
        "map_walk_dark": "太暗了,请开灯。",
        "map_walk_lost": "位置丢失。请退回几步,到还认得的地方。",
        "map_walk_slow_down": "慢一点。",
        "map_walk_look_ahead": "请看前方。",
        "map_walk_weak": "这一段较弱。请看门、标志和墙角。",
        "map_walk_found": "位置已找回,请继续。",
        "map_walk_loop": "很好,路线已闭合。",
        "map_none": "还没有地图。按住主键即可录制。",
        "map_no_picture": "摄像头没有画面,现在没有录制。",
        "map_picture": "摄像头恢复工作。",
        "map_disk_full": "磁盘已满,地图录制已结束。",
        "map_disk_slow": "磁盘太慢,请站住片刻。",
        "map_not_recorded": "无法录制地图,录制已结束。",
        "map_no_feedback": "仍在录制,但不再有提示。",
        "map_recorded": "已录制,有{places}个地点。正在生成地图。",
        "map_handed_over": "已录制,有{places}个地点。地图由控制台的电脑生成。",
        "map_building": "正在生成地图:百分之{percent}。",
        "map_not_built": "无法生成地图。仍用旧地图,录像已保留。",
        "map_too_short": "走得太短,不能作为地图。仍用旧地图,录像已保留。",
        "map_unfinished": "有一次地图录制中断了,正在生成它的地图。",
        "map_built": "新地图已启用:道路{metres}米,{places}个地点,{loops}个闭环。",
        "map_built_good": "没有薄弱路段。",
        "map_built_weak": "{count}段薄弱,最长{metres}米,离起点{from_m}米。",
        "destination": "前往{name}。",
        "destination_console": "控制台带您前往{name}。",
        "refused_off_duty": "设备已停用,按主键启用。",
        "refused_on_duty": "设备已经启用。",
        "refused_no_map": "还没有地图。按住主键即可录制,或由控制台发送。",
        "refused_mapping": "正在录制地图,长按主键结束。",
        "refused_no_map_walk": "没有在录制地图。",
        "refused_not_led": "现在没有导航。",
        "refused_led": "正在导航,请先停止。",
        "refused_paused": "导航已经暂停。",
        "refused_not_paused": "导航没有暂停。",
        "menu_by_distance": "地点按距离排列。",
        "menu_by_name": "地点按名称排列。",
        "menu_entry": "{name},{distance}。第{number}个,共{count}个。",
        "menu_entry_here": "{name},就在这里。第{number}个,共{count}个。",
        "menu_entry_unknown": "{name}。第{number}个,共{count}个。",
        "menu_closed": "列表已关闭。",
        "menu_empty": "没有可去的地点。",
        "where_here": "您在{name}。",
        "where_near": "{name}在{direction},距离{distance}。",
        "where_goal": "到{name}还有{distance}。",
        "where_next": "途中{distance}后是{name}。",
        "where_unknown": "您的位置未知。",
        "where_last": "{seconds}秒前您离{name}{distance}。",
        "where_no_place": "位置已知,但没有命名的地点。",
        "at_ahead": "正前方",
        "at_behind": "正后方",
        "at_degrees_left": "左边{degrees}度",
        "at_degrees_right": "右边{degrees}度",
        "at_clock": "{hour}点钟方向",
        "at_half_left": "左前方",
        "at_half_right": "右前方",
        "at_full_left": "左边",
        "at_full_right": "右边",
        "at_sharp_left": "左后方",
        "at_sharp_right": "右后方",
    },
}

PLACE_KINDS: dict[Language, dict[str, str]] = {
    "en": {"stairs": "stairs", "lift": "lift", "door": "door", "entrance": "entrance", "exit": "exit"},
    "zh": {"stairs": "楼梯", "lift": "电梯", "door": "门", "entrance": "入口", "exit": "出口"},
}
"""Kinds of places at which the walker does something else than walk past: said before a name that does not say it."""
HAZARD_KINDS = frozenset({"stairs"})

_SPEECH_START_S: dict[Language, float] = {"en": 0.38, "zh": 0.25}
_S_PER_HAN = 0.23
_S_PER_DIGIT: dict[Language, float] = {"en": 0.22, "zh": 0.16}
_S_PER_CHARACTER: dict[Language, float] = {"en": 0.058, "zh": 0.04}
"""As espeak-ng speaks at the device's rates, over all texts of this file."""


def stop_text(reason: Reason, language: Language) -> str:
    """Return what is said with a stop."""
    return STOP_TEXTS[language][reason]


def distance_text(distance_m: float, language: Language, decimals: int = 0) -> str:
    """Return a distance in words: "1 metre", "6 metres", "0.6 metres"."""
    number = f"{distance_m:.{decimals}f}"
    if language == "zh":
        return f"{number}米"
    return f"{number} metre" if number == "1" else f"{number} metres"


def place_text(name: str, kind: str, distance_m: float, language: Language) -> str:
    """Return the announcement of a place: its kind is said where that matters and the name does not say it."""
    texts, distance = TEXTS[language], distance_text(distance_m, language)
    word = PLACE_KINDS[language].get(kind, "")
    says_itself = not word or word.casefold() in name.casefold()
    if kind in HAZARD_KINDS:
        key = "hazard_ahead_named" if says_itself else "hazard_ahead"
    else:
        key, word = ("poi_ahead" if says_itself else "poi_ahead_kind"), word.capitalize()
    return texts[key].format(name=name, kind=word, distance=distance)


def speech_duration_s(text: str, language: Language) -> float:
    """Return about how long a text takes to be spoken, seconds; 0 for no text."""
    if not text:
        return 0.0
    han = sum("\u4e00" <= character <= "\u9fff" for character in text)
    digits = sum(character.isdigit() for character in text)
    rest_s = _S_PER_DIGIT[language] * digits + _S_PER_CHARACTER[language] * (len(text) - han - digits)
    return _SPEECH_START_S[language] + _S_PER_HAN * han + rest_s
