// Units and nouns of the device on the page: of one that moves in a line until the server says otherwise.

export const unit = {
  impedance: "N·s/m", stiffness: "N/m", force: "N", milli: "mm", micro: "µm", pushed: "Force", depth: "depth", motion: "linear",
};

export function speak(words) {
  Object.assign(unit, words);
}

export const turns = () => unit.motion === "rotary";
