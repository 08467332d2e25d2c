// The settings as they stand in the address of the page.

const isTable = (value) => value !== null && typeof value === "object" && !Array.isArray(value);

/** What an address holds, as a table; the names of what is none of the page's go to those left out. */
export function parsed(hash, left) {
  let found = {};
  try {
    if (hash.length > 1) found = JSON.parse(decodeURIComponent(hash.slice(1)));
  } catch {
    found = null;
  }
  if (!isTable(found)) left.add("all of it");
  for (const [key, value] of Object.entries(isTable(found) ? found : {})) {
    if (!["a", "b", "on"].includes(key) || (key !== "on" && value !== null && !isTable(value))) left.add(key);
  }
  return isTable(found) ? found : {};
}

/**
 * What the page knows of the settings of an address; the names of the rest go to those left out.
 * @param given a column of the address.
 * @param fresh settings of a page that nobody has touched.
 * @param about what the server said of the page.
 * @param motions that a touch may have.
 */
export function known(given, left, fresh, about, motions) {
  const kept = JSON.parse(JSON.stringify(fresh));
  const names = { values: about.fields.map((one) => one.key), gains: about.gains.map((one) => one.key.replace("gains.", "")), own: about.own.map((one) => one.key.replace("own.", "")) };
  const fits = {
    device: (value) => value === null || isTable(value) || about.devices.some((one) => one.name === value),
    method: (value) => [...about.live, ...about.slow].includes(value),
    motion: (value) => motions.includes(value),
  };
  for (const [key, value] of Object.entries(given && typeof given === "object" ? given : {})) {
    if (key in names) {
      for (const [name, one] of Object.entries(value && typeof value === "object" ? value : {})) {
        if (names[key].includes(name) && (one === null || typeof one !== "object")) kept[key][name] = one;
        else left.add(name);
      }
    } else if (key in fits && fits[key](value)) kept[key] = value;
    else left.add(key in fits ? `${key} ${JSON.stringify(value)}` : key);
  }
  return kept;
}
