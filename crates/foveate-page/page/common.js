const say = (value, places = 2) => value === null || value === undefined ? '–' : value.toFixed(places).replace('-', '−');
function complain(error) {
  byId('message').textContent = error ? (error.message || String(error)) : '';
  byId('message').hidden = !error;
}
// Returns a handler that does the work, and shows its error.
const doing = work => async event => {
  try { complain(null); await work(event); } catch (error) { complain(error); }
};
