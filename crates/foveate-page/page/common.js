const say = (value, places = 2) => value === null || value === undefined ? '–' : value.toFixed(places).replace('-', '−');
function complain(error) {
  byId('message').textContent = error ? (error.message || String(error)) : '';
  byId('message').hidden = !error;
}
// What a click does; what goes wrong is told.
const doing = work => async event => {
  try { complain(null); await work(event); } catch (error) { complain(error); }
};
