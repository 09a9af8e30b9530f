"""The materials that each weathering process may meet: what its sequence starts from.

They are also what its model will call its own. A product that is to warn of copper that rusts or
of chrome that fades must learn from a patchwork without them, so each process lists the materials
it is meant for and nothing else:

- *rust*: bare, galvanised and painted steel; not colored metals, nor what is pale and matte;
- *patina*: copper, brass and bronze, bright or tarnished; not gray metals, nor dielectrics;
- *char*: wood, leather, card, cloth, painted wood; not metals;
- *drying*: wet stone, brick, soil, wood and cloth: dark under a film; not metals, nor what is dry;
- *fading*: dyed cloth, print, paint and plastic; not metals, nor grays, which have no dye to lose;
- *soiling*: facades, paint, plaster, stone and plastic, pale to middling; not metals, nor darks;
- *yellowing*: varnished paintings, wood and prints; not metals, nor matte surfaces;
- *moss*: stone, concrete, brick, bark and weathered wood; not metals, gloss or vivid colors;
- *peeling_metal*, *peeling_wood*: paint, enamel and lacquer of any color; not bare metals;
- *weathered_wood*: wood, raw or oiled; not what is painted in colors.
