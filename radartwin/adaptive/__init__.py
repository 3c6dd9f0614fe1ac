"""No more modelled than a scene needs: the cheapest model whose features stay within their measured repeatability.

`model` says what can be left out, `limits` how far a feature may move, `probe` what a model does to the features of a thinned recording,
`choice` leaves out, one thing after another, what the features do not need, and says why.
"""
