// The CD player for XState: an actor of a machine.
import { createActor, createMachine } from 'xstate';
import { action, measure } from './harness.mjs';

const to = (target, name) => ({ target, actions: action(name) });

const machine = createMachine({
  initial: 'Empty',
  states: {
    Empty: { on: { open_close: to('Open', 'open_drawer'), cd: to('Stopped', 'store_cd_info') } },
    Open: { on: { open_close: to('Empty', 'close_drawer') } },
    Stopped: {
      on: {
        play: to('Playing', 'start_playback'),
        open_close: to('Open', 'open_drawer'),
        stop: to('Stopped', 'stopped_again'),
      },
    },
    Playing: {
      initial: 'One',
      on: {
        stop: to('Stopped', 'stop_playback'),
        pause: to('Paused', 'pause_playback'),
        open_close: to('Open', 'stop_and_open'),
      },
      states: {
        One: { on: { next: to('Two', 'next_song') } },
        Two: { on: { next: to('Three', 'next_song'), prev: to('One', 'previous_song') } },
        Three: { on: { prev: to('Two', 'previous_song') } },
      },
    },
    Paused: {
      on: {
        end_pause: to('Playing', 'resume_playback'),
        stop: to('Stopped', 'stop_playback'),
        open_close: to('Open', 'stop_and_open'),
      },
    },
  },
});
const player = createActor(machine);
player.start();
measure('xstate', (type) => ({ type }), (event) => player.send(event));
