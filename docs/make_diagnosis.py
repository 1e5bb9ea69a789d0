"""Run the example of docs/explanation/diagnosis.md and draw its figure: docs/figures/diagnosis.png.

python docs/make_diagnosis.py
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from threading import Event

from matplotlib.figure import Figure

from sma_sim.challenge.make import make_challenge
from sma_sim.evidence.data.train_test_split import hold_out_last
from sma_sim.evidence.estimation.executors import executor_or_threads
from sma_sim.evidence.estimation.prepared_fit import prepare
from sma_sim.evidence.estimation.search_context import SearchContext
from sma_sim.evidence.model_selection.nominal_fit import DiagnosisRequest, nominal_fits
from sma_sim.evidence.search.beam import Book, search
from sma_sim.evidence.search.posterior import posterior_of
from sma_sim.evidence.search.refine import WINDOW, on_run_subset
from sma_sim.report.palette import BLUE, GREY
from sma_sim.report.style import plain_axes, save, sized_figure

PICTURE = Path(__file__).resolve().parents[1] / 'docs' / 'figures' / 'diagnosis.png'
SEED, HIDDEN = 5020, ('natural_convection', 'gravity')
NAMED = 2  # models of a level that are named
WIDTH = 0.15  # of a level's marks
LEAST = 0.5  # [nats] at which the best ones are drawn
NEXT_LINE = 1.45  # ratio between the places of two names
Row = tuple[float, float, tuple[str, ...]]  # nats behind the best model, normalized RMSE, names of components


def main() -> None:
    """Search the example, print its posterior, draw all models that were fitted."""
    made = make_challenge(SEED, len(HIDDEN), kinds=HIDDEN)
    training, _ = hold_out_last(made.dataset, None)
    with executor_or_threads(None) as pool:
        context, start = SearchContext(pool, Event(), print), prepare(training, made.nominal)
        nominal = nominal_fits(start, DiagnosisRequest().options, context)
        book = search([on_run_subset(fit) for fit in nominal], context)
    posterior, rows = posterior_of(book), rows_of(book)
    for behind, error, names in rows:
        print(f'{behind:10.1f} {error:7.3f} {" + ".join(names)}')
    print('none', posterior.none, 'unlisted', posterior.unlisted, dict(posterior.effects))
    save(draw(rows), PICTURE)


def rows_of(book: Book) -> list[Row]:
    """Every set of components with the better of the kinetics, the best first."""
    k, found = book.overdispersion, dict[frozenset[str], Row]()
    for model in book.ranked():
        row = book.best.score(k) - model.score(k), model.fit.error, tuple(sorted(model.names))
        found.setdefault(model.names, row)
    return list(found.values())


def draw(rows: Sequence[Row]) -> Figure:
    """Every model: how far it lies behind the best, by how many components it has."""
    figure = sized_figure(9.0, 4.6)
    axis = figure.subplots()
    plain_axes(axis)
    axis.axhspan(LEAST, WINDOW, color=BLUE, alpha=0.12, lw=0, label=f'within {WINDOW:g} nats of the best')
    levels = sorted({len(names) for _, _, names in rows})
    for size in levels:
        own = [(max(behind, LEAST), error, names) for behind, error, names in rows if len(names) == size]
        axis.hlines([at for at, _, _ in own], size, size + WIDTH, color=GREY, lw=1.0)
        axis.hlines([at for at, _, _ in own if at <= WINDOW], size, size + WIDTH, color=BLUE, lw=2.5)
        place = 0.0
        for at, error, names in own[:NAMED]:
            place = max(at, NEXT_LINE * place)
            words = f'{" + ".join(names) or "nominal"} ({error:.2f})'
            axis.text(size + WIDTH + 0.03, place, words, size=6.5, va='center')
    axis.set(
        yscale='log',
        ylabel='log probability behind the best model [nats]',
        xlabel='components beside the nominal model',
        xticks=levels,
        xlim=(levels[0] - 0.05, levels[-1] + 1.7),
    )
    axis.invert_yaxis()
    axis.legend(frameon=False, loc='upper left')
    return figure


if __name__ == '__main__':
    main()
