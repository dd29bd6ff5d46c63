// Several targets: which of them the panels are about, and the way to add one or to drop it.
function drawTargets() {
  const several = page.targets.length > 1;
  byId('targets').hidden = !several;
  if (!several) return;
  const choices = page.targets.map((target, i) => {
    const row = rowOf(page.frame, target), now = i === page.target;
    const button = element('button', { type: 'button', class: 'wide', 'aria-pressed': String(now), title: `Target ${i + 1}` }, `Target ${i + 1}`, row && !row.usable ? ` (${row.status})` : '');
    button.addEventListener('click', doing(async () => { page.target = i; await show(page.frame); }));
    return button;
  });
  const drop = element('button', { type: 'button', class: 'wide' }, `Drop target ${page.target + 1}`);
  drop.addEventListener('click', doing(dropTarget));
  // Who uses keys stays where he was.
  const held = [...byId('targets').children].indexOf(document.activeElement);
  byId('targets').replaceChildren(...choices, drop);
  if (held >= 0) byId('targets').children[Math.min(held, choices.length)].focus();
}
async function dropTarget() {
  pause();
  await idle();
  page.busy = true;
  try {
    await tracker.ask({ op: 'remove', session: page.video.session, target: page.target });
    page.targets.splice(page.target, 1);
    page.version++;
    page.target = Math.max(0, page.target - 1);
  } finally { page.busy = false; }
  forgetSaved();
  await show(page.frame);
  command();
}
