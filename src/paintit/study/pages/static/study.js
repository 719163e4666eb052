// Saves at every click and says so. Without this file the form still works: Next sends all of it.
const form = document.getElementById("ratings");
const state = document.getElementById("state");
let wanted = 0; // changes made
let saved = 0; // changes the server has confirmed
let busy = false;

async function save() {
  if (busy) return;
  busy = true;
  while (saved < wanted) {
    const upTo = wanted;
    try {
      const answer = await fetch(form.action, {
        method: "POST",
        headers: { Accept: "application/json" },
        body: new URLSearchParams(new FormData(form)),
        keepalive: true,
      });
      if (!answer.ok) throw new Error(String(answer.status));
      saved = upTo;
      say(`${rated()} of ${form.querySelectorAll("fieldset").length} rated, saved`, false);
    } catch {
      say("Not saved: the server does not answer. Trying again; please leave this page open.", true);
      await new Promise((resolve) => setTimeout(resolve, 1500));
    }
  }
  busy = false;
}

function rated() {
  return form.querySelectorAll("input:checked").length;
}

function say(text, failed) {
  state.textContent = text;
  state.classList.toggle("failed", failed);
}

form.addEventListener("change", () => {
  wanted += 1;
  save();
});

// Leaving while the server is away would lose the page and what it holds.
form.addEventListener("submit", (event) => {
  if (state.classList.contains("failed")) event.preventDefault();
});

// 1 to 5 rate the picture that has the focus.
form.addEventListener("keydown", (event) => {
  const group = event.target.closest("fieldset");
  const radio = group && /^[1-5]$/.test(event.key) && group.querySelector(`input[value="${event.key}"]`);
  if (radio) {
    radio.focus();
    radio.click();
  }
});
