// Searches `sections` ({location, title, text}), which stand above; all words must occur.
function countOf(text, word) {
  return text.toLowerCase().split(word).length - 1;
}

function search(query) {
  var words = query.toLowerCase().split(/\s+/).filter(Boolean);
  return sections.map(function (section) {
    var score = 0;
    for (var word of words) {
      var inTitle = countOf(section.title, word), inText = countOf(section.text, word);
      if (inTitle + inText === 0) return { score: 0 };
      score += 20 * inTitle + Math.min(inText, 10);
    }
    return { score: score, section: section, word: words[0] };
  }).filter(function (hit) { return hit.score > 0; })
    .sort(function (a, b) { return b.score - a.score; });
}

function show(hits, place) {
  place.textContent = hits.length ? "" : place.getAttribute("data-no-results-text");
  hits.slice(0, 50).forEach(function (hit) {
    var at = Math.max(hit.section.text.toLowerCase().indexOf(hit.word) - 80, 0);
    var article = document.createElement("article"), heading = document.createElement("h3");
    var link = document.createElement("a"), text = document.createElement("p");
    link.href = hit.section.location;
    link.textContent = hit.section.title;
    text.textContent = hit.section.text.slice(at, at + 240);
    heading.appendChild(link);
    article.append(heading, text);
    place.appendChild(article);
  });
}

window.addEventListener("load", function () {
  var place = document.getElementById("mkdocs-search-results");
  if (!place) return;
  var input = document.getElementById("mkdocs-search-query");
  input.value = new URLSearchParams(window.location.search).get("q") || "";
  input.addEventListener("input", function () { show(search(input.value), place); });
  show(search(input.value), place);
});
