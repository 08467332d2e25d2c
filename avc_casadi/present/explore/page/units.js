// Units and nouns of the device on the page: of one that moves in a line until the server says otherwise.

export const unit = {
  impedance: "N·s/m", stiffness: "N/m", force: "N", milli: "mm", pushed: "Force", depth: "depth",
};

export function speak(words) {
  Object.assign(unit, words);
}
