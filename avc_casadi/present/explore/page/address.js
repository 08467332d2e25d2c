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
