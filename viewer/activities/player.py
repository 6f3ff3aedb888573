"""The timeline's editing and playing: keyframes and playhead."""

import time
from collections.abc import Callable
from dataclasses import replace

from core.export.keyframes import MAX_LENGTH, MIN_GAP, Timeline, View
from core.models.scene import Scene
from viewer.editor import Editor
from viewer.services.jobs import Jobs

_GESTURE = "play"  # gesture of playing and scrubbing, so that either is one step of undo
_STEP = 1.0  # s from the last keyframe to an appended one


class Player:
    """Edits the timeline and shows its scene at the playhead, which moves while playing, as a drag would."""

    def __init__(self, jobs: Jobs, editor: Editor, clock: Callable[[], float] = time.monotonic) -> None:
        self._jobs = jobs
        self._editor = editor
        self._clock = clock
        self.seconds = 0.0  # time of the playhead
        self._began: float | None = None  # s on the clock when the playhead was at 0; None unless playing
        self._last_scene: Scene | None = None  # scene of the last tick; another one is an edit
        self._last_timeline: Timeline | None = None  # timeline of the last tick; another one is an edit

    @property
    def timeline(self) -> Timeline:
        """The timeline of the editor's state."""
        return self._editor.state.timeline

    @property
    def playing(self) -> bool:
        """True while the playhead moves."""
        return self._began is not None

    @property
    def key(self) -> int | None:
        """The index of the keyframe at the playhead, if any."""
        return self.timeline.nearest(self.seconds)

    def close(self) -> None:
        """Stop playing."""
        self._began = None

    def toggle(self) -> None:
        """Play or pause."""
        self.pause() if self.playing else self.play()

    def play(self) -> None:
        """Play from the playhead, or from the beginning if the playhead is at the end."""
        if not self._editor.playable.keys:
            return
        if not self.timeline.loop and self.seconds >= self.timeline.length - 1e-3:
            self.seconds = 0.0
        self._editor.end_gesture()
        self._began = self._clock() - self.seconds
        self._show()

    def pause(self) -> None:
        """Pause at the playhead."""
        if self.playing:
            self.close()
            self._editor.end_gesture()

    def seek(self, seconds: float) -> None:
        """Move the playhead and show its frame; :meth:`Editor.end_gesture` ends the drag."""
        self.close()
        self.seconds = max(0.0, min(self.timeline.length, seconds))
        if self._editor.playable.keys:
            self._show()

    def tick(self) -> None:
        """Advance the playhead while playing; any edit stops it. Call once a frame."""
        if self._began is None:
            return
        if self._editor.scene is not self._last_scene or self.timeline is not self._last_timeline:
            self.close()
            return
        length = self.timeline.length
        passed = self._clock() - self._began
        self.seconds = passed % length if self.timeline.loop else min(passed, length)
        self._show()
        if passed >= length and not self.timeline.loop:
            self.pause()
        self._jobs.worker.wake()

    # Edits of the timeline

    def add_key(self) -> None:
        """Make the view a keyframe at the playhead or, if that has one, after the last keyframe."""
        self.pause()
        timeline = self.timeline
        gap = MIN_GAP if timeline.loop else 0.0
        seconds = min(self.seconds, timeline.length - gap)
        if timeline.nearest(seconds) is not None:
            seconds = min(timeline.keys[-1].seconds + _STEP, MAX_LENGTH - gap)
            room = seconds + (_STEP if timeline.loop else 0.0)
            timeline = replace(timeline, length=min(MAX_LENGTH, max(timeline.length, room)))
        scene = self._editor.scene
        self._editor.set_timeline(timeline.added(seconds, View(scene.instance, scene.camera)))
        self.seconds = seconds
        self._jobs.messages.notify(f"Keyframe {(self.key or 0) + 1} of {len(self.timeline.keys)}, at {seconds:.1f} s")

    def remove_key(self, index: int) -> None:
        """Remove a keyframe."""
        self.pause()
        self._editor.set_timeline(self.timeline.removed(index))

    def move_key(self, index: int, seconds: float) -> None:
        """Move a keyframe to another time and show it; :meth:`Editor.end_gesture` ends the drag."""
        moved = self.timeline.moved(index, seconds)
        gesture = f"key {index}"
        self.close()
        self.seconds = moved.keys[index].seconds
        self._editor.set_timeline(moved, gesture)
        if not moved.keys[index].view.instance.is_missing:
            self._editor.show(*moved.keys[index].view, gesture)

    def go_to_key(self, index: int) -> None:
        """Move the playhead to a keyframe and show it."""
        self.seek(self.timeline.keys[index].seconds)
        self._editor.end_gesture()

    def step(self, by: int) -> None:
        """Show the next keyframe after the playhead (1) or the previous one (-1), if any."""
        ahead = [index for index, key in enumerate(self.timeline.keys) if by * (key.seconds - self.seconds) > 1e-6]
        if ahead:
            self.go_to_key(min(ahead) if by > 0 else max(ahead))

    def stretch(self, length: float) -> None:
        """Scale the timeline to another length in seconds; :meth:`Editor.end_gesture` ends the drag."""
        stretched = self.timeline.stretched(length)
        self.close()
        self.seconds *= stretched.length / self.timeline.length
        self._editor.set_timeline(stretched, "timeline length")

    def loop(self, loop: bool) -> None:
        """Set whether the timeline continues from its last keyframe to its first."""
        self.pause()
        self._editor.set_timeline(self.timeline.looped(loop))

    def _show(self) -> None:
        view = self._editor.playable.at(self.seconds)
        self._editor.show(view.instance, view.camera, gesture=_GESTURE)
        self._last_scene = self._editor.scene
        self._last_timeline = self.timeline
