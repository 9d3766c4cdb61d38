"""A word typed into a page's search field in a browser, and how long each keystroke took."""

from selenium import webdriver

# From a keystroke until the page is drawn and takes the next one.
_TYPED = """
const [word, done] = arguments, field = document.getElementById('search'), took = [];
const type = (length) => {
  if (length > word.length) return done(took);
  const begun = performance.now();
  field.value = word.slice(0, length);
  field.dispatchEvent(new Event('input', {bubbles: true}));
  document.body.offsetHeight;
  requestAnimationFrame(() => setTimeout(() => { took.push(performance.now() - begun); type(length + 1); }));
};
type(1);
"""  # noqa: E501


def typed(browser: webdriver.Chrome, word: str) -> list[float]:
    """Milliseconds of each keystroke."""
    took: list[float] = browser.execute_async_script(_TYPED, word)
    return took
