// What the page opens on, and the stories behind its buttons: a case, and how the sentence about it begins and ends.
const SURVEYED = 0.019; // displacement of a rotor [m], after which two rows of the matrix are 1.3 degrees apart

/** Return the shipped hexarotor with rotor 2 a little out of place. */
const moved = (yaml) => yaml
  .replace('name: hexarotor', 'name: hexarotor, rotor 2 off by 19 mm')
  .replace(/(positions: .*\n *)0\.2,/, `$1${0.2 + SURVEYED},`);

export const STORIES = {
  roll: {
    label: 'More roll than there is', vehicle: 'hexarotor', start: 'over',
    state: {demand: [9.81, 3, 0, 0], beside: 'pseudo_inverse', shown: ['roll', 'pitch']},
    lead: 'Asked for 3 N m of roll, more than this hexarotor has:',
    end: 'exact gives as much roll as there is, and keeps thrust, pitch and yaw. Clipping gives less, and thrust that ' +
      'nobody asked for.',
  },
  lost: {
    label: 'A rotor is lost', vehicle: 'hexarotor', start: 'lost',
    state: {health: [0, 1, 1, 1, 1, 1], beside: 'fixed_pseudo_inverse', shown: ['roll', 'pitch', 'yaw']},
    lead: 'Rotor 1 is lost at hover:',
    end: 'A lost rotor costs part of the torques (thin lines: with all rotors) and the balance of yaw: the vehicle spins ' +
      'slowly, and flies. A method that does not know of it lets the vehicle fall and pitch over.',
  },
  airmode: {
    label: 'Airmode', vehicle: 'quadrotor', start: 'over',
    state: {demand: [2, 0.7, 0, 0], beside: 'pseudo_inverse', shown: ['thrust', 'roll']},
    lead: 'Roll at low thrust, as in a descent:',
    end: 'exact raises thrust to keep control, which is called airmode. Pull the airmode limit to 0 %: thrust stays at ' +
      '2 N, and of roll 0.325 N m are left.',
  },
  missed: {
    label: 'What a pseudo-inverse misses', vehicle: 'hexarotor', start: 'over',
    state: {demand: [6, 1, 1, 0.1], beside: 'pseudo_inverse', shown: ['roll', 'pitch', 'yaw']},
    lead: 'This demand is attainable:',
    end: 'The pseudo-inverse asks rotors for less than their minimum. Clipping them changes all axes, though other ' +
      'thrusts produce the demand.',
  },
  px4: {
    label: 'A geometry that crashed PX4', vehicle: moved, start: 'over',
    state: {demand: [9.81, 0.2, 0.1, 0], health: [0, 1, 1, 0, 1, 1], beside: 'pseudo_inverse_of_all_axes',
      shown: ['roll', 'pitch']},
    lead: 'Rotor 1 has failed, its opposite is stopped, and one arm is 19 mm longer:',
    end: 'The rows of pitch and yaw are 1.3 degrees apart, so the inverse of the matrix has gains of hundreds. On such a ' +
      'geometry PX4 lifted off from idle, until its pull request 28589. ca_ros finds that yaw is not independent, and ' +
      'gives it up.',
  },
};
