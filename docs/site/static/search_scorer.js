/* The order of what a search finds, for Sphinx's search (searchtools.js calls `Scorer.score`).

First come pages with the words in their title, then headings and names with them, and pages with
them in a heading, then pages by how often the words stand in their text. A word counts as a whole,
in any of its forms; what has no more than parts of words comes last. */
const pageWords = new Map();

/* The stems of the words of a text, and of the parts of names such as slip_ratio and ReplayPage. */
const stemsOf = (text) => {
  const stemmer = new Stemmer();
  const parts = (word) => word.split(/_|(?<=\p{Lower})(?=\p{Upper})/u).filter((part) => part);
  return splitQuery(text)
    .flatMap((word) => [...new Set([word, ...parts(word)])])
    .map((word) => stemmer.stemWord(word.toLowerCase()));
};

const wordsOfPage = (name) => {
  if (!pageWords.has(name)) {
    const page = new DOMParser().parseFromString(PAGE_TEXTS[name] ?? "", "text/html");
    const headings = [...page.querySelectorAll("h2, h3, h4, h5, h6")];
    pageWords.set(name, {
      title: stemsOf(page.querySelector("h1")?.textContent ?? ""),
      headings: headings.map((heading) => stemsOf(heading.textContent)),
      text: stemsOf(page.body.textContent),
    });
  }
  return pageWords.get(name);
};

/* Which part of the words of a title or name is searched for, 0 to 1; 0 where one is missing. */
const share = (asked, words) =>
  asked.every((word) => words.includes(word)) ? asked.length / Math.max(words.length, 1) : 0;

/* How much a text is about the words, 0 to 1: how often the rarest of them stands in it, against a
   thousand words of text. */
const weight = (asked, text) => {
  const count = Math.min(...asked.map((word) => text.filter((other) => other === word).length));
  return count / (count + 1 + text.length / 1000);
};

const scoreOfPage = (asked, name) => {
  const { title, headings, text } = wordsOfPage(name);
  const about = weight(asked, text);
  const inTitle = share(asked, title);
  if (inTitle) return 3 + (inTitle + about) / 2;
  if (headings.some((heading) => share(asked, heading))) return 2 + about;
  return about ? 1 + about : 0;
};

var Scorer = {
  objNameMatch: 11,
  objPartialMatch: 6,
  objPrio: { 0: 15, 1: 5, 2: -5 },
  objPrioDefault: 0,
  title: 15,
  partialTitle: 7,
  term: 5,
  partialTerm: 2,

  score: ([page, title, anchor, , given, , kind]) => {
    const query = new URLSearchParams(location.search).get("q") ?? "";
    const asked = [...Search._parseQuery(query)[1]];
    const parts = given / 1000;
    if (kind === SearchResultKind.text || !anchor) return parts + scoreOfPage(asked, page);
    const name = title.split(kind === SearchResultKind.object ? "." : " > ").at(-1);
    const found = share(asked, stemsOf(name));
    return parts + (found ? 2 + found : 0);
  },
};
