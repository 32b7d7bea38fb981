"""The CD player for sismic, whose charts are YAML."""

from sismic.interpreter import Interpreter
from sismic.io import import_from_yaml
from sismic.model import Event

from harness import ACTIONS, action, measure

CHART = """
statechart:
  name: CD player
  root state:
    name: CdPlayer
    initial: Empty
    states:
      - name: Empty
        transitions:
          - {event: open_close, target: Open, action: open_drawer()}
          - {event: cd, target: Stopped, action: store_cd_info()}
      - name: Open
        transitions:
          - {event: open_close, target: Empty, action: close_drawer()}
      - name: Stopped
        transitions:
          - {event: play, target: Playing, action: start_playback()}
          - {event: open_close, target: Open, action: open_drawer()}
          - {event: stop, target: Stopped, action: stopped_again()}
      - name: Playing
        initial: One
        transitions:
          - {event: stop, target: Stopped, action: stop_playback()}
          - {event: pause, target: Paused, action: pause_playback()}
          - {event: open_close, target: Open, action: stop_and_open()}
        states:
          - name: One
            transitions:
              - {event: next, target: Two, action: next_song()}
          - name: Two
            transitions:
              - {event: next, target: Three, action: next_song()}
              - {event: prev, target: One, action: previous_song()}
          - name: Three
            transitions:
              - {event: prev, target: Two, action: previous_song()}
      - name: Paused
        transitions:
          - {event: end_pause, target: Playing, action: resume_playback()}
          - {event: stop, target: Stopped, action: stop_playback()}
          - {event: open_close, target: Open, action: stop_and_open()}
"""

player = Interpreter(import_from_yaml(CHART), initial_context={name: action(name) for name in ACTIONS})
player.execute_once()


def dispatch(event):
    player.queue(event)
    player.execute_once()


measure("sismic", Event, dispatch)
