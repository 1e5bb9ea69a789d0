"""The search: sets of components, level by level, each level the best few of the one before with one component more."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field, replace

from sma_sim.evidence.estimation.fit_result import FitResult
from sma_sim.evidence.estimation.search_context import SearchContext
from sma_sim.evidence.model_selection.nominal_fit import report_model
from sma_sim.evidence.search import propose
from sma_sim.evidence.search.components import Catalogue, Component, catalogue_for
from sma_sim.evidence.search.refine import SKETCHED, WINDOW, Model, better, extended, in_other_kinetics, model_of, without

MAX_COMPONENTS = 3  # of a model: it bounds the time of a search, and recordings of few runs seldom tell more
PARENTS = 3  # models of a level that are extended
EQUATIONS_AFTER = 2  # components: one listed effect that leaves nothing needs no equation, two may imitate a single one
EXCHANGED = 6  # components that are tried in place of one
EXCHANGE_SHARE = 0.5  # of what that one promises, which they must: to first order neither is exact
ROUNDS = 3  # of exchanges of the best model's components, each from where the last has led


@dataclass
class Book:
    """All models that were fitted, each in its best valley; `kinetics`: whether both are tried."""

    catalogue: Catalogue
    kinetics: bool
    models: dict[tuple[frozenset[str], str], Model] = field(default_factory=dict)

    def add(self, models: Iterable[Model | None]) -> list[Model]:
        """Keep models, of two fits of one the better; those as they stand now."""
        found = []
        for model in models:
            if model is not None:
                self.models[model.key] = better(model, self.models.get(model.key))
                found.append(self.models[model.key])
        return found

    @property
    def overdispersion(self) -> float:
        """What the best model so far leaves: no other model leaves less."""
        return min(model.evidence.overdispersion for model in self.models.values())

    @property
    def best(self) -> Model:
        """The best of all models."""
        return self.ranked()[0]

    def find(self, names: frozenset[str]) -> Model | None:
        """The better of the models with these components."""
        return next((model for model in self.ranked(len(names)) if model.names == names), None)

    def leaves_nothing(self, size: int) -> bool:
        """Whether the best model of a number of components leaves nothing."""
        return any(model.leaves_nothing for model in self.ranked(size)[:1])

    def ranked(self, size: int | None = None) -> list[Model]:
        """Models by score, the best first; of a number of components, if one is given."""
        k = self.overdispersion
        chosen = [model for model in self.models.values() if size is None or len(model.components) == size]
        return sorted(chosen, key=lambda model: -model.score(k))


def search(nominal: Sequence[FitResult], context: SearchContext, equations: bool = True, most: int = MAX_COMPONENTS) -> Book:
    """The models that explain the recordings, from the nominal one with each of the kinetics to try.

    Listed effects and differences between recordings first; then, where these leave something, terms of equations. `most`:
    components of a model.
    """
    book = Book(catalogue_for(nominal[0], context), len(nominal) > 1)
    book.add(model_of((), [fit], context) for fit in nominal)
    for size in range(1, most + 1):
        before = book.best
        for parent in parents(book, size - 1):
            expand(parent, book, context)
            if book.leaves_nothing(size):
                break  # what other parents lead to has few nats to win; exchanges below look for it
        improve(size, book, context)
        if equations and size == EQUATIONS_AFTER and (book.best.lacks_unlisted or len(book.best.components) == size):
            add_equations(book.ranked(0)[0], book, context)
        if context.stop.is_set() or (size >= EQUATIONS_AFTER and book.best is before):
            break
        if book.best.leaves_nothing and len(book.best.components) < size:
            break
    best = book.best
    if equations and best.components and best.lacks_unlisted and not any(one.is_formula for one in best.components):
        add_equations(best, book, context)
    return book


def add_equations(base: Model, book: Book, context: SearchContext) -> None:
    """Terms of an equation beside the components of a model."""
    if context.stop.is_set():
        return
    context.on_progress(f'fitting the terms of an equation at every port beside {words(base)}')
    leads = add_extended(base, components_of(propose.terms(base.fit, context)), book, context)
    if leads:
        names = min(leads, key=lambda model: model.fit.cost).names
        add_equation_neighbours(book.find(names) or leads[0], book, context)


def add_equation_neighbours(lead: Model, book: Book, context: SearchContext) -> None:
    """Other terms at the port of one, and a second one at its place, proposed where it has led."""
    term = lead.components[-1]
    for _ in range(ROUNDS):
        if lead.leaves_nothing or context.stop.is_set():
            return
        context.on_progress(f'{term.name}: normalized RMSE {lead.fit.error:.2f}; fitting other terms in its place')
        fewer, there = without(lead, term, context)
        others = components_of(propose.terms(there, context, term, same_port=True)) if fewer else []
        start = replace(lead, components=lead.components[:-1], fit=there)
        found = add_extended(start, others, book, context, restarts=False)
        best = min([lead, *found], key=lambda model: model.fit.cost)
        if best.names == lead.names:
            break
        lead, term = best, best.components[-1]
    if not lead.leaves_nothing and not context.stop.is_set():
        add_extended(lead, components_of(propose.terms(lead.fit, context, term)), book, context)


def components_of(proposals: Sequence[propose.Proposal]) -> list[Component]:
    """The components of the best proposals."""
    return [one.component for one in proposals[:SKETCHED]]


def parents(book: Book, size: int) -> list[Model]:
    """The models of a level to extend: the best few that have weight beside the best of them, whatever their kinetics."""
    chosen: list[Model] = []
    ranked, k = book.ranked(size), book.overdispersion
    for model in ranked:
        near = model.score(k) >= ranked[0].score(k) - WINDOW
        if near and len(chosen) < PARENTS and model.names not in [other.names for other in chosen]:
            chosen.append(model)
    return chosen


def expand(parent: Model, book: Book, context: SearchContext) -> None:
    """Add to the book what a model may lack one of, fitted."""
    taken = {component.plain_name for component in parent.components}
    context.on_progress(f'what {words(parent)} may lack')
    proposals = propose.listed(parent.fit, book.catalogue, taken, context)[:SKETCHED]
    more = propose.differing(parent.fit, parent.names, context) if not parent.leaves_nothing else []
    chosen = [one.component for one in (*proposals, *more)]
    if not parent.components and not parent.leaves_nothing:
        tried = {component.name for component in chosen}
        chosen += propose.stepped(book.catalogue, tried, taken, book.catalogue.effects)
    add_extended(parent, chosen, book, context)


def add_extended(
    parent: Model, components: Sequence[Component], book: Book, context: SearchContext, restarts: bool = True
) -> list[Model]:
    """Add models with one component more."""
    if not components or context.stop.is_set():
        return []
    context.on_progress(f'fitting {", ".join(component.name for component in components)}')
    found = book.add(extended(parent, components, context, restarts))
    for model in found:
        report_model('candidate', model.fit, context)
    try_kinetics(book, context)
    return found


def try_kinetics(book: Book, context: SearchContext) -> None:
    """The best model with the other kinetics, unless they were tried."""
    names = {key[0] for key in book.models if key[1] != book.best.key[1]}
    if book.kinetics and book.best.names not in names and not context.stop.is_set():
        book.add([in_other_kinetics(book.best, context)])


def improve(size: int, book: Book, context: SearchContext) -> None:
    """Exchange or drop each component of the best model of a level, as long as that leads further."""
    for _ in range(ROUNDS if book.ranked(size) else 0):
        best = book.ranked(size)[0]
        for component in best.components:
            exchange(best, component, book, context)
        if context.stop.is_set() or book.ranked(size)[0] is best:
            return


def exchange(best: Model, component: Component, book: Book, context: SearchContext) -> None:
    """Models with another component in place of one, proposed where the parameters of the best one lie: nearer to the true
    ones than those of any model without it."""  # fmt: skip
    if component.is_difference or context.stop.is_set():
        return
    context.on_progress(f'what may stand in place of {component.name}')
    fewer, there = without(best, component, context)
    book.add([fewer])
    rest = tuple(one for one in best.components if one.name != component.name)
    taken = {one.plain_name for one in rest}
    known = {model.names for model in book.models.values()}
    proposals = propose.listed(there, book.catalogue, taken, context)
    own = next((one.promise for one in proposals if one.component.name == component.name), 0.0)
    chosen = [
        one.component for one in proposals
        if one.promise >= EXCHANGE_SHARE * own and frozenset((*(r.name for r in rest), one.component.name)) not in known
    ]  # fmt: skip
    if chosen and fewer is not None:
        start = Model(rest, there, fewer.evidence)
        add_extended(start, chosen[:EXCHANGED], book, context, restarts=False)


def words(model: Model) -> str:
    """What progress calls a model."""
    return ' + '.join(component.name for component in model.components) or 'the nominal model'
