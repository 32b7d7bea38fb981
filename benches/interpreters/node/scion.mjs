// The CD player for @scion-scxml/core, a chart as SCXML's elements in JSON.
import { createRequire } from 'node:module';
import { action, measure } from './harness.mjs';

const scion = createRequire(import.meta.url)('@scion-scxml/core');

const on = (event, target, name) => ({ event, target, onTransition: action(name) });

// A function that makes the model: a model itself would be copied without its actions.
const player = new scion.Statechart(() => ({
  id: 'CdPlayer',
  initial: 'Empty',
  states: [
    { id: 'Empty', transitions: [on('open_close', 'Open', 'open_drawer'), on('cd', 'Stopped', 'store_cd_info')] },
    { id: 'Open', transitions: [on('open_close', 'Empty', 'close_drawer')] },
    {
      id: 'Stopped',
      transitions: [
        on('play', 'Playing', 'start_playback'),
        on('open_close', 'Open', 'open_drawer'),
        on('stop', 'Stopped', 'stopped_again'),
      ],
    },
    {
      id: 'Playing',
      initial: 'One',
      transitions: [
        on('stop', 'Stopped', 'stop_playback'),
        on('pause', 'Paused', 'pause_playback'),
        on('open_close', 'Open', 'stop_and_open'),
      ],
      states: [
        { id: 'One', transitions: [on('next', 'Two', 'next_song')] },
        { id: 'Two', transitions: [on('next', 'Three', 'next_song'), on('prev', 'One', 'previous_song')] },
        { id: 'Three', transitions: [on('prev', 'Two', 'previous_song')] },
      ],
    },
    {
      id: 'Paused',
      transitions: [
        on('end_pause', 'Playing', 'resume_playback'),
        on('stop', 'Stopped', 'stop_playback'),
        on('open_close', 'Open', 'stop_and_open'),
      ],
    },
  ],
}));
player.start();
measure('scion', (name) => ({ name }), (event) => player.gen(event));
