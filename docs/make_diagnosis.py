"""Run the example of docs/explanation/diagnosis.md and draw its figure: docs/figures/diagnosis.png.

python docs/make_diagnosis.py
"""

from __future__ import annotations

from pathlib import Path
from threading import Event

from matplotlib.figure import Figure

from sma_sim.challenge.make import make_challenge
from sma_sim.evidence.data.train_test_split import hold_out_last
from sma_sim.evidence.estimation.executors import executor_or_threads
from sma_sim.evidence.estimation.search_context import SearchContext
from sma_sim.evidence.model_selection.nominal_fit import DiagnosisRequest, nominal_fits
from sma_sim.evidence.search.beam import Book, search
from sma_sim.evidence.search.posterior import posterior_of
from sma_sim.evidence.search.refine import WINDOW, Model, on_run_subset
from sma_sim.report.palette import BLUE, GREY
from sma_sim.report.style import plain_axes, save, sized_figure

PICTURE = Path(__file__).resolve().parents[1] / 'docs' / 'figures' / 'diagnosis.png'
SEED, HIDDEN = 5020, ('natural_convection', 'gravity')
NAMED = 3  # models of a level that are named
WIDTH = 0.28  # of a level's marks


def main() -> None:
    """Search the example, print its posterior, draw all models that were fitted."""
    made = make_challenge(SEED, len(HIDDEN), kinds=HIDDEN)
    training, _ = hold_out_last(made.dataset, None)
    with executor_or_threads(None) as pool:
        context, request = SearchContext(pool, Event(), print), DiagnosisRequest()
        book = search([on_run_subset(fit) for fit in nominal_fits(training, made.nominal, request, context)], context)
    posterior = posterior_of(book)
    k = posterior.overdispersion
    for model in book.ranked():
        print(f'{model.score(k) - posterior.best.score(k):12.1f} {model.fit.error:8.3f} {" + ".join(sorted(model.names))}')
    for model, weight in zip(posterior.models, posterior.weights, strict=True):
        print(f"{weight:.3f}", " + ".join(sorted(model.names)))
    print("none", posterior.none, "unlisted", posterior.unlisted, dict(posterior.effects))
    save(draw(book), PICTURE)


def draw(book: Book) -> Figure:
    """Every model: how far it lies behind the best, by how many components it has."""
    figure = sized_figure(8.0, 4.6)
    axis = figure.subplots()
    plain_axes(axis)
    k, best = book.overdispersion, book.best.score(book.overdispersion)
    axis.axhspan(0.5, WINDOW, color=BLUE, alpha=0.12, lw=0, label=f'within {WINDOW:g} nats of the best')
    levels = sorted({len(model.components) for model in book.models.values()})
    for size in levels:
        ranked = book.ranked(size)
        behind = [max(best - model.score(k), 0.5) for model in ranked]
        axis.hlines(behind, size, size + WIDTH, color=GREY, lw=1.0)
        axis.hlines(behind[:1], size, size + WIDTH, color=BLUE, lw=2.5)
        place = 0.0
        for model, at in list(zip(ranked, behind, strict=True))[:NAMED]:
            place = max(at, 1.6 * place)
            axis.text(size + WIDTH + 0.03, place, words(model), size=7, va='center')
    axis.set(
        yscale='log', ylabel='log probability behind the best model [nats]', xlabel='components beside the nominal model',
        xticks=levels, xlim=(levels[0] - 0.05, levels[-1] + 1.0),
    )  # fmt: skip
    axis.invert_yaxis()
    axis.legend(frameon=False, loc='lower right')
    return figure


def words(model: Model) -> str:
    """The components of a model, below each other."""
    return '\n'.join(sorted(model.names)) or 'nominal model'


if __name__ == '__main__':
    main()
